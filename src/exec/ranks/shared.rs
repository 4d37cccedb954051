//! What the post and the rank's other threads tell one another.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use super::packet::Letter;
use super::transport::Crew;
use super::{RankError, Recorded};

/// What the rank's other threads have the post do.
pub enum Control {
    Send {
        to: usize,
        letter: Letter,
    },
    Attach {
        number: u32,
        crew: Box<Crew>,
    },
    Detach {
        number: u32,
    },
    /// Leave the other ranks, and end.
    Leave,
    /// End the processes of all ranks.
    Abort {
        status: u8,
    },
}

/// What the post tells the rank's other threads.
#[derive(Default)]
pub struct Shared {
    /// A rank that is gone.
    pub lost: Mutex<Option<RankError>>,
    /// By rank.
    pub hosts: Mutex<Vec<String>>,
    /// Bytes of rows that have left for other ranks.
    pub row_bytes: AtomicU64,
    /// By rank, what a packet takes to it, milliseconds, and each byte of a large one; rank 0 knows it.
    pub links: Mutex<Vec<(f64, f64)>>,
    /// What other ranks have recorded and nobody has taken yet.
    pub recorded: Mutex<Vec<Recorded>>,
}

impl Shared {
    pub fn lost(&self) -> Option<RankError> {
        self.lost.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn host(&self, rank: usize) -> String {
        let hosts = self.hosts.lock().unwrap_or_else(PoisonError::into_inner);
        hosts.get(rank).cloned().unwrap_or_default()
    }
}
