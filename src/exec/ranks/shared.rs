//! Orders and state that the post shares with the rank's other threads.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use super::RankError;
use super::packet::Letter;
use super::transport::RendererDevices;

/// Order to the post from the rank's other threads.
pub enum Control {
    Send {
        to: usize,
        letter: Letter,
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

/// Trace spans that another rank has recorded of its threads.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    pub rank: usize,
    /// Zero of its times, in milliseconds after [`Node::epoch`](super::Node::epoch) here.
    pub zero_ms: f64,
    /// Maximum error of `zero_ms`, in µs; `None` while the rank's clock is not known.
    pub residual_us: Option<f64>,
    /// Spans in the format of [`Host::recorded`](super::Host::recorded).
    pub text: Vec<u8>,
}

/// State that the post shares with the rank's other threads.
#[derive(Default)]
pub struct Shared {
    /// Error of a lost rank.
    pub lost: Mutex<Option<RankError>>,
    /// Host names, by rank.
    pub hosts: Mutex<Vec<String>>,
    /// Bytes of rows sent to other ranks.
    pub row_bytes: AtomicU64,
    /// Latency in milliseconds from rank 0 to each rank, and milliseconds per byte of large packets; known on rank 0
    /// only.
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
