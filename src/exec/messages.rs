//! What renderer and workers say to one another.

use std::sync::Arc;
use std::time::Duration;

use super::TaskTiming;
use super::faults::InjectedKind;
use super::planner::Plan;
use crate::device::DeviceFailure;
use crate::graph::Resource;
use crate::stages::{Place, layout};

/// What the renderer tells a worker.
pub struct Command {
    /// Comes back with the answer; no two commands of a run have the same but those of one attempt at a frame.
    pub ticket: u64,
    /// How long the device may take for one thing that is waited for.
    pub limit: Duration,
    pub order: Order,
}

pub enum Order {
    Frame(Box<FrameJob>),
    /// Send both eyes' image in this place back, once what is to happen to the device has happened.
    Read {
        image: Resource,
        place: Place,
        injected: Option<InjectedKind>,
    },
}

#[derive(Clone)]
pub struct FrameJob {
    pub plan: Plan,
    pub constants: layout::Frame,
    pub previous: [layout::View; 2],
    /// Where it leaves its images.
    pub place: Place,
    /// Outputs that the primary sends back with its answer, beside the row tallies.
    pub reads: Arc<[Resource]>,
    /// How often dispatches run; more than once only to try slow devices out.
    pub runs: u32,
    /// What is to happen to the device half-way.
    pub injected: Option<InjectedKind>,
}

/// What a worker answers.
pub struct Reply {
    pub ticket: u64,
    pub device: usize,
    pub answer: Result<Answer, Stop>,
}

pub enum Answer {
    Frame(FrameReply),
    Pixels(Pixels),
}

/// An image of both eyes, as it lies on the device.
pub type Pixels = [Vec<u8>; 2];

/// Why a worker did not do what it was told.
#[derive(Clone)]
pub enum Stop {
    /// Its own device failed.
    Device(DeviceFailure),
    /// Another's did.
    Aborted,
}

impl From<DeviceFailure> for Stop {
    fn from(failure: DeviceFailure) -> Self {
        Self::Device(failure)
    }
}

impl From<String> for Stop {
    fn from(what: String) -> Self {
        Self::Device(what.into())
    }
}

/// A device's part of a frame, done.
pub struct FrameReply {
    pub tasks: Vec<TaskTiming>,
    /// When the device turned to the frame, and when it was done; milliseconds since the origin.
    pub begin_ms: f64,
    pub end_ms: f64,
    /// From the primary: the row tallies of the whole frame, and what was to be read.
    pub images: Vec<(Resource, Pixels)>,
}

/// What workers send one another.
pub enum Message {
    Rows {
        ticket: u64,
        transfer: u32,
        bytes: Vec<u8>,
    },
    /// A device cannot go on with this attempt, so nobody who waits for it can.
    Abort {
        ticket: u64,
    },
}
