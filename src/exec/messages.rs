//! Messages between the renderer and the workers: plain data that can be serialised and sent between processes.

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::faults::InjectedKind;
use super::late_latching::{Late, SampledPose};
use super::output::Output;
use super::plan::Plan;
use super::watch::Watch;
use super::wire;
use crate::device::DeviceFailure;
use crate::device::staging::Mapped;
use crate::layout;
use crate::schedule::Splits;
use crate::stages::Place;
use crate::tables::SceneUpdate;

/// Order from the renderer to a worker.
#[derive(Debug, Serialize, Deserialize)]
pub struct Order {
    /// Number that the answer repeats. All orders of one attempt at a frame have the same ticket, which no other
    /// order of the run has.
    pub ticket: u64,
    /// Timeout of each wait on the device.
    pub limit: Duration,
    pub work: Work,
}

#[derive(Debug, Serialize, Deserialize)]
pub enum Work {
    Frame(Box<FrameJob>),
    /// Send back an image of all views, from the buffers that `place` selects. If `injected` is given, inject this
    /// fault first.
    Read {
        image: Output,
        place: Place,
        injected: Option<InjectedKind>,
    },
}

/// A frame, of which each worker executes the tasks of its device.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FrameJob {
    /// Plan that determines the graph, together with the settings that all frames of a run share.
    pub plan: Plan,
    #[serde(with = "wire::pod")]
    pub constants: layout::Frame,
    /// Constants of the previous frame.
    #[serde(with = "wire::pod")]
    pub previous: layout::Previous,
    /// Each view of this and of the previous frame.
    #[serde(with = "wire::pods")]
    pub views: Vec<[layout::View; 2]>,
    /// Changes to the scene tables.
    pub update: SceneUpdate,
    /// Selects the buffers that the frame writes.
    pub place: Place,
    /// Images that the primary returns with its answer, in addition to the row tallies.
    pub reads: Vec<Output>,
    pub splits: Splits,
    /// Source of the late-latched pose, for the primary. It is not sent to other ranks.
    #[serde(skip)]
    pub late: Option<Late>,
    /// Number of runs of each dispatch; more than 1 only to simulate slow devices.
    pub runs: u32,
    /// Fault to inject after half of the device's tasks.
    pub injected: Option<InjectedKind>,
    /// `None` if nothing watches the frame. It is not sent to other ranks.
    #[serde(skip)]
    pub watch: Option<Arc<Watch>>,
}

/// Answer of a worker to an order.
#[derive(Debug, Serialize, Deserialize)]
pub struct Reply {
    pub ticket: u64,
    pub device: usize,
    pub answer: Result<Answer, Stop>,
}

#[derive(Debug, Serialize, Deserialize)]
pub enum Answer {
    Frame(FrameReply),
    Pixels(Pixels),
}

/// An image of all views, in the device's memory layout.
pub type Pixels = Vec<Vec<u8>>;

/// Reason for which a worker did not execute an order.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Stop {
    /// Its own device failed.
    Device(DeviceFailure),
    /// Another device failed.
    Aborted,
}

/// Result of a device's part of a frame.
#[derive(Debug, Serialize, Deserialize)]
pub struct FrameReply {
    pub times: Vec<TaskTime>,
    /// Maximum error of the device's times so far, in microseconds.
    pub clock_residual_us: f64,
    /// Begin and end of the frame on this device, in milliseconds. On rank 0 they count from the renderer's origin;
    /// other ranks send times on their own clock, which rank 0 converts.
    pub begin_ms: f64,
    pub end_ms: f64,
    /// Row tallies of the whole frame, then the requested images; only from the primary.
    pub images: Vec<Pixels>,
    /// Late-latched pose; only from the primary, if it is on rank 0.
    #[serde(skip)]
    pub shown_from: Option<Box<SampledPose>>,
    /// Buffers of each output of the frame; only from the primary, if it is on rank 0.
    #[serde(skip)]
    pub buffers: Vec<(Output, Vec<wgpu::Buffer>)>,
    /// Samples of each path-traced pixel, without those of hole filling, if the frame has ended early.
    pub spp_done: Option<u32>,
}

/// Execution time of a task.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TaskTime {
    /// Index among the tasks of its device.
    pub task: usize,
    /// Begin and end in milliseconds, on the same clock as [`FrameReply::begin_ms`].
    pub begin_ms: f64,
    pub end_ms: f64,
    /// Size of a transfer in bytes; `None` for other tasks.
    pub bytes: Option<u64>,
    /// Number of submissions that the task was split into.
    pub submissions: u32,
}

/// Message to a worker from another worker, or an abort from the renderer. `B` is the type that holds the bytes of
/// image rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message<B = Bytes> {
    Rows {
        ticket: u64,
        transfer: u32,
        rows: B,
    },
    /// A device cannot continue this attempt, so workers must stop waiting for its rows.
    Abort {
        ticket: u64,
    },
}

/// Bytes of rows: mapped memory of the source device, or an owned buffer if they come from another process.
pub enum Bytes {
    Mapped(Mapped),
    Owned(Vec<u8>),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Mapped(mapped) => mapped,
            Self::Owned(bytes) => bytes,
        }
    }
}

impl fmt::Debug for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes", self.len())
    }
}

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(self)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Vec::deserialize(deserializer).map(Self::Owned)
    }
}
