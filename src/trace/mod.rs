//! Chrome traces of a run: records host spans, device lanes, counters and arrows in one file, and reads it back.
//!
//! A [`TraceFile`] owns the file of a run; its [`Recorder`]s go to all code that records times. All times are
//! microseconds since [`Recorder::origin`].

pub mod compare;
pub mod critical;
pub mod deadline;
mod document;
mod event_fields;
pub mod event;
mod file;
pub mod frames;
mod growing;
mod host;
pub mod intervals;
pub mod late;
mod median;
pub mod rank_transfers;
pub mod read;
mod recorder;
pub mod summary;
pub mod work;

use serde::{Deserialize, Serialize};

use crate::image::ImageError;
use event::Track;
pub use file::TraceFile;
pub use host::HostSpans;
pub use recorder::Recorder;

/// Number of the process under which host spans and counters are shown.
pub const HOST_PID: u32 = 1;
/// Device `i` is process `FIRST_DEVICE_PID + i`.
pub const FIRST_DEVICE_PID: u32 = 10;
/// Threads of rank `r` are shown as process `FIRST_RANK_PID + r`, except those of the recording rank.
pub const FIRST_RANK_PID: u32 = 100;
/// Track of frames, from planning to the complete images on the primary.
pub const FRAMES_TRACK: Track = Track { pid: HOST_PID, tid: 1 };
const FRAMES_NAME: &str = "frames";
/// Number of tracks for frames. Frames in flight overlap, so they cannot share a track.
const FRAMES_TRACKS: u32 = 4;
/// Track of the time that each frame has on a display, and of missed deadlines.
const DEADLINES_TRACK: Track = Track { pid: HOST_PID, tid: FRAMES_TRACK.tid + FRAMES_TRACKS };
const DEADLINES_NAME: &str = "deadlines";
/// Number of the first thread's track; the others follow.
const FIRST_THREAD_TID: u32 = DEADLINES_TRACK.tid + 1;

#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    #[error("host spans cannot be recorded: this process already has a tracing subscriber")]
    SubscriberTaken,
    #[error(transparent)]
    Write(#[from] ImageError),
    #[error("cannot read trace '{path}'")]
    Read { path: String, source: std::io::Error },
    #[error("'{path}' is not a trace: {what}")]
    NotATrace { path: String, what: String },
    #[error("'{path}', event {index} (counted from 0): {what}")]
    Event { path: String, index: usize, what: String },
    #[error("'{path}' has no frames of diptych devices: give a trace recorded by a diptych run")]
    NoFrames { path: String },
    #[error("'{path}' has no deadlines: give a trace of `diptych play`")]
    NoDeadlines { path: String },
    #[error("'{path}' has no frame {frame}: it has {count} frames, from {first} to {last}")]
    NoSuchFrame { path: String, frame: u64, count: usize, first: u64, last: u64 },
}

/// Concurrent lanes of a device: work on the left eye, the right eye or both, and transfers from and to the host. If a rig
/// has more views, `Left` is its sources, and `Right` all others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Lane {
    Left,
    Right,
    Both,
    Upload,
    Download,
}

impl Lane {
    pub const ALL: [Lane; 5] = [Lane::Left, Lane::Right, Lane::Both, Lane::Upload, Lane::Download];

    pub fn name(self) -> &'static str {
        match self {
            Lane::Left => "left",
            Lane::Right => "right",
            Lane::Both => "both",
            Lane::Upload => "upload",
            Lane::Download => "download",
        }
    }

    pub fn is_transfer(self) -> bool {
        matches!(self, Lane::Upload | Lane::Download)
    }

    /// Returns the track of this lane on device `device`.
    pub fn track(self, device: u32) -> Track {
        Track { pid: FIRST_DEVICE_PID + device, tid: self as u32 + 1 }
    }
}

#[cfg(test)]
mod tests;
