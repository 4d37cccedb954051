//! The commands of a device.

use std::hash::{Hash, Hasher};
use std::ops::Range;

use super::workgroups::Groups;
use crate::graph::Bound;
use crate::scene::rig::Eye;
use crate::wgsl::{Words, shared_structs};

/// One step of a device's share of a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Set the frame's constants, and update the scene's tables.
    Begin,
    /// Set an image to zero; of a list, only the counts of pixels and workgroups.
    Clear(EyeImage),
    /// Run the kernel of the pass with this index in the program. `begins` and `ends` are the indices of the timestamps
    /// to write at its begin and its end.
    Dispatch {
        pass: usize,
        launches: Vec<Launched>,
        begins: Option<u32>,
        ends: Option<u32>,
    },
    /// Build the acceleration structures of dynamic geometry from the vertices that the pass with this index wrote.
    Build {
        pass: usize,
        ends: Option<u32>,
    },
    /// Keep a copy of an image that a pass binds at this number.
    Save {
        binding: usize,
        image: EyeImage,
    },
    /// Bring the image back that the last [`Command::Save`] of this number kept.
    Restore {
        binding: usize,
        image: EyeImage,
    },
    /// Copy rows for another device. They are sent once the copy has been submitted.
    CopyOut {
        transfer: u32,
        rows: Rows,
    },
    /// Wait for rows of another device, and write them.
    CopyIn {
        transfer: u32,
        rows: Rows,
    },
    /// Copy the timestamps, which the next frame overwrites.
    Stamps,
    /// Wait until the device has completed all submissions, then ask for the late-latched pose, which the next
    /// submission uses.
    Ask,
    /// End the command encoder. This takes host time, since wgpu encodes only now.
    Close,
    /// Submit the recorded commands, including copies of these rows. The device first executes pending writes.
    Submit(Vec<Outgoing>),
    /// Run the task with this index, whose time is unknown, in submissions that grow with what the device has timed.
    /// `stamps` is the index of the first of its two timestamps.
    Probe {
        task: usize,
        stamps: Option<u32>,
    },
    Inject(InjectedKind),
}

/// Fault to inject into a device in the middle of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum InjectedKind {
    /// The device is destroyed.
    Loss,
    /// Its worker blocks for ever.
    Hang,
    /// Its dispatches run twice.
    Slow,
    /// It reports that it is out of memory.
    Oom,
}

impl InjectedKind {
    pub const ALL: [(&str, Self); 4] =
        [("loss", Self::Loss), ("hang", Self::Hang), ("oom", Self::Oom), ("slow", Self::Slow)];

    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

/// Rows that have been copied for another device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Outgoing {
    pub ticket: u64,
    pub transfer: u32,
    pub to: usize,
}

/// The image of an eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EyeImage {
    pub bound: Bound,
    pub eye: Eye,
}

/// Rows of an image that a task moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Index of the task among those of its device.
    pub task: usize,
    pub image: EyeImage,
    pub rows: Range<u32>,
}

/// One run of a pass's kernel.
#[derive(Clone, Debug, PartialEq)]
pub struct Launched {
    /// Selects the pipeline, where kernels of jittered and of unjittered frames differ.
    pub jitter: bool,
    pub constants: PassConstants,
    pub groups: Groups,
}

shared_structs! {
    /// Constants of a dispatch.
    pub struct PassConstants {
        /// 0 in a source, and 1 in each other view.
        pub view: u32,
        /// The rows to compute: the first, and the one after the last.
        pub row_begin: u32,
        pub row_end: u32,
        /// Rows that may be read: the stripe plus the received or recomputed rows around it.
        pub valid_begin: u32,
        pub valid_end: u32,
        /// Arguments of the kernel; their meaning depends on the pass.
        pub args: Words,
        /// Columns and rows of the pass's grid.
        pub width: u32,
        pub height: u32,
        /// Number of the device.
        pub device: u32,
    }
}

/// A dispatch that is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timed {
    /// Index of the task among those of its device.
    pub task: usize,
    /// Number of submissions that the task is split into; 0 for a [`Command::Probe`], which finds out.
    pub submissions: u32,
}

/// A device's share of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Commands {
    /// The commands of the device's own tasks, whose results other devices may wait for, then those of the stitch.
    pub list: Vec<Command>,
    /// Number of commands of the device's own tasks.
    pub own: usize,
    /// The timed dispatches: that with the index i writes the timestamps 2 i and 2 i + 1.
    pub timed: Vec<Timed>,
}

impl Eq for Commands {}

/// Lists of equal length have the same hash: a state machine that holds lists only needs to tell its states apart.
impl Hash for Commands {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.list.len().hash(state);
    }
}
