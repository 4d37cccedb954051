//! How frames came to a headset.

use std::fmt;

use serde::Serialize;

use super::quantiles::Quantiles;

/// A frame in a headset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct HeadsetRow {
    /// The instant for which the runtime predicted its display, seconds since that of the first frame.
    pub display_s: f64,
    /// The period of the display, which a runtime may stretch for programs that take longer.
    pub period_ms: f64,
    /// The predicted time from motion to photon: from when the pose was taken that the frame is shown from to its display, or if
    /// it came too late for that, to the next one. It is `null` where the runtime does not tell the time.
    pub motion_to_photon_ms: Option<f64>,
    /// The time by which the pose that it is shown from is newer than the one that it was rendered at, where it was corrected.
    pub corrected_ms: Option<f64>,
    /// The time from when the frame was handed over to its predicted display, negative if it came too late for that.
    pub ahead_ms: Option<f64>,
    /// Periods of the display between the frame before and this one, as the runtime predicts them, without a frame.
    pub missed: u32,
}

/// A session with a headset.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct HeadsetSummary {
    pub runtime: String,
    pub headset: String,
    /// The size of each eye that the runtime recommends.
    pub recommended_size: String,
    /// The period of the display at first.
    pub period_ms: f64,
    /// Whether the distance of what is seen was handed over as well.
    pub depth: bool,
    /// Whether images were copied through the host's memory, as the first device is not on the runtime's adapter.
    pub host_copies: bool,
    /// Whether frames were corrected to where the head was when all else of them was done.
    pub late_poses: bool,
    /// The states that the session went through.
    pub states: Vec<String>,
    pub motion_to_photon_ms_p50: Option<f64>,
    pub motion_to_photon_ms_p95: Option<f64>,
    pub motion_to_photon_ms_max: Option<f64>,
    /// Frames that were handed over after their predicted display.
    pub late_frames: usize,
    /// Periods of the display without a frame.
    pub missed: u64,
}

/// Sums over the frames of a session, in memory that does not grow with their number.
#[derive(Clone, Debug, Default)]
pub struct HeadsetTally {
    motion_to_photon_ms: Quantiles,
    late_frames: usize,
    missed: u64,
}

impl HeadsetTally {
    /// Adds a frame.
    pub fn add(&mut self, row: &HeadsetRow) {
        row.motion_to_photon_ms.into_iter().for_each(|ms| self.motion_to_photon_ms.add(ms));
        self.late_frames += usize::from(row.ahead_ms.is_some_and(|ms| ms < 0.0));
        self.missed += u64::from(row.missed);
    }
}

impl HeadsetSummary {
    /// Fills in the sums over frames.
    pub fn with(self, frames: &HeadsetTally) -> Self {
        Self {
            motion_to_photon_ms_p50: frames.motion_to_photon_ms.median(),
            motion_to_photon_ms_p95: frames.motion_to_photon_ms.quantile(0.95),
            motion_to_photon_ms_max: frames.motion_to_photon_ms.most(),
            late_frames: frames.late_frames,
            missed: frames.missed,
            ..self
        }
    }
}

impl fmt::Display for HeadsetSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(p50), Some(p95)) = (self.motion_to_photon_ms_p50, self.motion_to_photon_ms_p95) {
            write!(f, "motion to photon, predicted, ms: median {p50:.1}, 95 % {p95:.1}; ")?;
        }
        let Self { late_frames, missed, .. } = self;
        write!(f, "{late_frames} frames came after their predicted display; {missed} of its periods were missed")
    }
}
