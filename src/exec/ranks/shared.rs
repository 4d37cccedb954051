//! Orders to the post from the rank's other threads, and state that it shares with them.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use super::RankError;
use super::packet::RankMessage;
use super::renderer_devices::RendererDevices;

/// Order to the post from the rank's other threads.
pub enum Control {
    Send {
        to: usize,
        message: RankMessage,
    },
    Attach {
        number: u32,
        renderer: Box<RendererDevices>,
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

/// Trace spans that another rank has recorded on its threads.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    pub rank: usize,
    /// Zero of the times in `text`, in milliseconds after the [`Node::epoch`](super::Node::epoch) of rank 0.
    pub zero_ms: f64,
    /// Maximum error of `zero_ms`, in µs; `None` before the first round trip to the rank.
    pub residual_us: Option<f64>,
    /// Spans in the format of [`Host::recorded`](super::Host::recorded).
    pub text: Vec<u8>,
}

/// State that the post shares with the rank's other threads.
#[derive(Default)]
pub struct Shared {
    /// Error of the first rank that was lost, if any.
    pub lost: Mutex<Option<RankError>>,
    /// Host names, by rank.
    pub hosts: Mutex<Vec<String>>,
    /// Number of bytes of image rows sent to other ranks.
    pub row_bytes: AtomicU64,
    /// For each rank, the one-way latency of the link from rank 0 in milliseconds, and its milliseconds per byte of
    /// large packets. Known on rank 0 only.
    pub links: Mutex<Vec<(f64, f64)>>,
    /// Trace spans that other ranks have recorded, until they are taken.
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
