//! Devices of several processes that render one frame: ranks, as MPI calls them. Rank 0 has the renderer. Each other rank
//! serves it with its own devices, and the post, a thread of each rank, carries what they tell one another over a
//! [`Link`]. Renderer and workers have the channels that they have within one process.

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

/// What starters of MPI programs tell each process: how many they start together, and which of them this one is.
const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "SLURM_STEP_NUM_TASKS"];
const NUMBERS: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID"];

fn told(names: &[&str]) -> Option<u32> {
    names.iter().filter_map(|name| std::env::var(name).ok()?.parse().ok()).max()
}

/// The number of this process among several that were started together, as far as is known before MPI is initialised; none
/// where it was started alone.
pub fn started_as() -> Option<u32> {
    told(&SIZES).filter(|&size| size > 1).map(|_| told(&NUMBERS).unwrap_or(0))
}

/// What the threads of another rank were at, as it has recorded it.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    pub rank: usize,
    /// The zero of its times, milliseconds after [`Node::epoch`] here.
    pub zero_ms: f64,
    /// How wrong that is at most; none where its clock is not known yet.
    pub residual_us: Option<f64>,
    /// As [`Host::recorded`] has it there.
    pub text: Vec<u8>,
}

/// Why ranks cannot go on together.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RankError {
    /// What a rank could not do.
    #[error("rank {rank} on {host}: {what}")]
    Refused { rank: usize, host: String, what: String },
    /// A rank that is gone.
    #[error("rank {rank} on {host} is lost: {what}")]
    Lost { rank: usize, host: String, what: String },
    #[error("{0} devices on all ranks are more than the 64 that one run can drive")]
    TooMany(usize),
}
