//! Rendering of a frame on the devices of several processes: ranks, in the terms of MPI. Rank 0 has the renderer, and
//! each other rank serves it with its own devices. The post, a thread of each rank, carries packets between ranks over
//! a [`Link`]. Renderer and workers use the same channels as within one process.

mod agree;
mod clock;
mod devices;
mod link;
#[cfg(feature = "mpi")]
mod mpi;
mod node;
mod packet;
mod peer;
mod post;
mod server;
mod shared;
#[cfg(all(feature = "mpi", target_os = "linux"))]
mod slices;
mod transport;

pub(super) use devices::Others;
pub use devices::{Devices, Loading, Opening};
pub use link::{ChannelLink, Link, Way, channel_links};
#[cfg(feature = "mpi")]
pub use mpi::MpiLink;
pub use node::{Asked, Node};
pub use packet::{Load, Request, Response};
pub use server::{Host, serve};

/// Environment variables by which MPI launchers tell each process how many they start (`SIZES`) and its own rank
/// (`NUMBERS`).
const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "SLURM_STEP_NUM_TASKS"];
const NUMBERS: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID"];

fn told(names: &[&str]) -> Option<u32> {
    names.iter().filter_map(|name| std::env::var(name).ok()?.parse().ok()).max()
}

/// Returns the rank of this process, if several were started together, as far as it is known before MPI is initialised.
/// Returns `None` if the process was started alone.
pub fn started_as() -> Option<u32> {
    told(&SIZES).filter(|&size| size > 1).map(|_| told(&NUMBERS).unwrap_or(0))
}

/// Trace spans that another rank has recorded of its threads.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    pub rank: usize,
    /// Zero of its times, in milliseconds after [`Node::epoch`] here.
    pub zero_ms: f64,
    /// Maximum error of `zero_ms`, in µs; `None` while the rank's clock is not known.
    pub residual_us: Option<f64>,
    /// Spans in the format of [`Host::recorded`].
    pub text: Vec<u8>,
}

/// Error that ends a run on several ranks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RankError {
    /// A rank that cannot take part, or could not execute a request.
    #[error("rank {rank} on {host}: {what}")]
    Refused { rank: usize, host: String, what: String },
    /// A rank that is lost.
    #[error("rank {rank} on {host} is lost: {what}")]
    Lost { rank: usize, host: String, what: String },
    #[error("{0} devices on all ranks are more than the 64 that one run can drive")]
    TooMany(usize),
}
