//! The tasks of a frame and their order.

use std::ops::Range;

use super::pass::Stage;
use crate::scene::rig::Eye;

/// Position of a task in the common order that all devices follow. A download comes after the task that produces its
/// rows, and an upload before the task that consumes them; `transfer_batches.rs` picks the exact passes. Every edge of
/// the graph goes from a smaller key to a larger one, so workers that execute their tasks in key order cannot deadlock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    /// Index of the pass.
    pub pass: u32,
    /// Upload, dispatch or download, in this order.
    pub phase: u8,
    pub serial: u32,
}

#[derive(Clone, Debug, PartialEq)]
pub enum TaskKind {
    Dispatch {
        /// Index among the program's passes.
        pass: usize,
        /// Rows that the dispatch may read, on the pass's grid: its own, and received or recomputed ones around them.
        valid: Range<u32>,
    },
    /// Copies rows from the device, to be sent to device `to`. There, the upload with the same `transfer` writes them.
    Download {
        /// Index among the program's images.
        image: usize,
        transfer: u32,
        to: usize,
    },
    Upload {
        image: usize,
        transfer: u32,
    },
    /// Marks the point at which both complete images are on the primary.
    Stitch,
}

/// Kind of a task that takes time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimedTask {
    /// A stage, timed by the device's own clock.
    Gpu(Stage),
    /// Rows copied from the device's memory to the host's.
    Download,
    /// Rows copied from the host's memory to the device's.
    Upload,
}

impl TimedTask {
    /// Returns the name in reports: that of the stage, `download` or `upload`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gpu(stage) => stage.name(),
            Self::Download => "download",
            Self::Upload => "upload",
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub kind: TaskKind,
    pub view: Eye,
    pub device: usize,
    /// The rows that are computed or moved, on the grid of the pass or of the image.
    pub rows: Range<u32>,
    pub key: Key,
}
