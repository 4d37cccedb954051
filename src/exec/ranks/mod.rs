//! Rendering of a frame on the devices of several processes: ranks, in the terms of MPI. Rank 0 has the renderer, and
//! each other rank serves it with its own devices. The post, a thread of each rank, carries packets between ranks over
//! a [`Link`]. Renderer and workers use the same channels as within one process.

mod agree;
mod clock;
mod devices;
mod error;
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
mod renderer_devices;

pub use agree::DeviceMismatch;
pub(super) use devices::Others;
pub use devices::{Devices, Loading, Opening};
pub use error::RankError;
pub use link::{Link, Way};
#[cfg(feature = "mpi")]
pub use mpi::MpiLink;
pub use node::{Asked, Node};
pub use packet::{Load, Request, Response};
pub use server::{Host, serve};
pub use shared::Recorded;

/// Environment variables in which MPI launchers pass to each process the number of processes (`SIZES`) and its own rank
/// (`NUMBERS`).
const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "SLURM_STEP_NUM_TASKS"];
const NUMBERS: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID"];

fn number_in_environment(names: &[&str]) -> Option<u32> {
    names.iter().filter_map(|name| std::env::var(name).ok()?.parse().ok()).max()
}

/// Returns the rank of this process from the environment variables of MPI launchers, before MPI is initialised. Returns
/// `None` if the process was started alone, and 0 if the variables contain the number of processes but not the rank.
pub fn started_as() -> Option<u32> {
    number_in_environment(&SIZES).filter(|&size| size > 1).map(|_| number_in_environment(&NUMBERS).unwrap_or(0))
}
