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
mod post;
mod server;
mod transport;

pub(super) use devices::Others;
pub use devices::{Devices, Loading, Opening};
pub use link::{ChannelLink, Link, channel_links};
#[cfg(feature = "mpi")]
pub use mpi::MpiLink;
pub use node::{Asked, Node};
pub use packet::{Load, Request, Response};
pub use server::{Host, serve};

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
