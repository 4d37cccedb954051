//! Executes frame graphs. One worker thread per device executes the tasks of its device, rows are transferred through
//! host memory, and the complete images are gathered on the primary, the first remaining device. README.md in this
//! folder describes the protocol.

mod builder;
mod channels;
mod costs;
mod error;
mod faults;
mod frames;
mod inputs;
mod late_latching;
mod ledger;
mod messages;
mod output;
mod per_view;
mod plan;
mod planner;
mod plausibility;
mod pose_source;
mod prediction;
pub mod ranks;
mod read;
mod recovery;
mod renderer;
mod report;
mod config;
mod stopping;
mod watch;
mod watchdog;
mod watched;
mod wire;
mod worker;
mod worker_pool;

#[doc(hidden)] // Public only for the test tests/models/protocol.rs.
pub mod protocol {
    pub use super::ledger::Ledger;
    pub use super::messages::Message;
    pub use super::worker::action::{Action, Ordered, Outcome};
    pub use super::worker::protocol::Protocol;
}

pub use crate::frame::{FrameParams, Injection};
pub use crate::graph::TimedTask;
pub use builder::{BuildError, Builder};
pub use error::ExecError;
pub use faults::{Fault, InjectedFaults, InjectedKind};
pub use late_latching::{PoseSource, SampledPose};
pub use per_view::PerView;
pub use renderer::Renderer;
pub use report::{FrameReport, RightEye, Tally, TaskTiming};
