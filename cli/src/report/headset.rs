//! Reports the timing of frames in a headset.

use std::fmt;

use serde::Serialize;

use super::quantiles::Quantiles;

/// Timing of a frame in a headset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct HeadsetRow {
    /// Predicted display time, seconds since that of the first frame.
    pub display_s: f64,
    /// Refresh period of the display. A runtime may stretch it for programs that need more time.
    pub period_ms: f64,
    /// Predicted motion-to-photon latency: time from sampling the head pose that the frame shows to the predicted
    /// display time, or to the next refresh if the frame was submitted too late. `null` if the runtime has no clock.
    pub motion_to_photon_ms: Option<f64>,
    /// Time from sampling the head pose that the frame was rendered with to sampling the newer pose that late
    /// reprojection corrected it to, if it was corrected.
    pub corrected_ms: Option<f64>,
    /// Time from submission to the predicted display time; negative if the frame was submitted too late.
    pub ahead_ms: Option<f64>,
    /// Number of display periods without a new frame between the previous frame and this one, by the runtime's
    /// predictions.
    pub missed: u32,
}

/// Summary of a session with a headset.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct HeadsetSummary {
    pub runtime: String,
    pub headset: String,
    /// Image size per eye that the runtime recommends.
    pub recommended_size: String,
    /// Refresh period of the display at the start.
    pub period_ms: f64,
    /// True if depth images were submitted together with the colour images.
    pub depth: bool,
    /// True if images were copied through host memory, because the first device is not on the runtime's adapter.
    pub host_copies: bool,
    /// True if late reprojection corrected frames for a head pose sampled after all other passes.
    pub late_poses: bool,
    /// OpenXR states that the session went through, in order.
    pub states: Vec<String>,
    pub motion_to_photon_ms_p50: Option<f64>,
    pub motion_to_photon_ms_p95: Option<f64>,
    pub motion_to_photon_ms_max: Option<f64>,
    /// Number of frames that were submitted after their predicted display time.
    pub late_frames: usize,
    /// Number of display periods without a new frame.
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
    /// Fills in the latency quantiles and the counts of late frames and missed display periods from `frames`.
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
        write!(f, "{late_frames} frames were submitted too late; {missed} display periods were missed")
    }
}
