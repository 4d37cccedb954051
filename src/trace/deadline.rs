//! Deadlines of frames on a display.

use serde::{Deserialize, Serialize};

use crate::exec::FrameReport;

/// Times of a frame on a display, milliseconds since the renderer's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deadline {
    /// Refresh at which the frame was to start.
    pub refresh_ms: f64,
    pub started_ms: f64,
    /// Time at which the host had the complete frame.
    pub complete_ms: f64,
    /// Refresh at which the frame was due.
    pub due_ms: f64,
    /// Number of refreshes, from the due one on, that showed no new frame.
    pub missed_periods: u32,
}

impl Deadline {
    /// Returns the time from the start to the complete frame, in milliseconds.
    pub fn whole_ms(&self) -> f64 {
        self.complete_ms - self.started_ms
    }

    /// Returns the time by which the frame was late, in milliseconds; negative if it was early.
    pub fn over_ms(&self) -> f64 {
        self.complete_ms - self.due_ms
    }

    pub fn period_ms(&self) -> f64 {
        self.due_ms - self.refresh_ms
    }

    pub fn is_missed(&self) -> bool {
        self.missed_periods > 0
    }

    /// Returns the host time before the frame's makespan in milliseconds, and that after it.
    pub fn host_ms(&self, report: &FrameReport) -> [f64; 2] {
        [report.begin_ms - self.started_ms, self.complete_ms - report.begin_ms - report.makespan_ms]
    }
}

/// Events around a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Disturbance or fault in this frame.
    pub event: Option<String>,
    /// Fraction of the cores that other programs took, if known.
    pub others: Option<f64>,
    /// Time in which the process did not run.
    pub paused_ms: f64,
}

/// A frame on a display.
#[derive(Clone, Debug, PartialEq)]
pub struct Presented {
    pub deadline: Deadline,
    /// Cause of the missed deadline; `None` for a frame in time.
    pub cause: Option<String>,
    pub around: Surroundings,
}

/// A frame on a display, as a trace records it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DisplayedFrame {
    pub frame: u64,
    /// Time by which the frame was late; negative if it was early.
    pub over_deadline_ms: f64,
    pub period_ms: f64,
    /// Sum of the next three.
    pub whole_ms: f64,
    pub host_before_ms: f64,
    pub makespan_ms: f64,
    pub host_after_ms: f64,
    pub missed_periods: u64,
    pub rung: Option<u64>,
    /// Makespan that the controller expected.
    pub expected_ms: Option<f64>,
    /// Fraction of the cores that other programs took.
    pub others_share: Option<f64>,
    pub disturbance: Option<String>,
    /// Cause of the missed deadline; `None` for a frame in time.
    pub cause: Option<String>,
}
