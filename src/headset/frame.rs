//! Frames of a headset session.

use openxr::Time;

use super::drawing::Pixels;
use super::input::Input;
use super::pacing::{between_ms, shown_at};
use super::panel::Panel;
use crate::exec::PerView;
use crate::scene::head::HeadPose;
use crate::scene::optics::HeadEyes;

/// Predicted pose of the head, and the time at which the prediction was made.
#[derive(Clone, Copy, Debug)]
pub struct HeadSample {
    pub head: HeadPose,
    pub(super) at: Option<Time>,
}

/// Result of waiting for the next frame.
#[derive(Debug)]
pub enum Next {
    /// A frame to render and show.
    Frame(Box<HeadsetFrame>),
    /// No frame is to be rendered now, since it would not be visible.
    Idle,
    Ended,
}

/// A frame that has begun.
#[derive(Clone, Copy, Debug)]
pub struct HeadsetFrame {
    pub(super) display: Time,
    pub(super) period_ns: i64,
    pub(super) sampled: Option<Time>,
    /// Predicted display time, seconds since that of the first frame.
    pub display_s: f64,
    /// Predicted pose of the head at the display time, in the session's LOCAL reference space.
    pub head: HeadPose,
    pub eyes: HeadEyes,
    /// Number of display periods without a frame since the previous frame.
    pub missed: u32,
    pub input: Input,
    /// Gaze point (x, y) in the left and the right eye's image, as fractions of width and height from the top left.
    /// `None` before a tracker has reported a gaze.
    pub gaze: Option<[[f64; 2]; 2]>,
}

impl HeadsetFrame {
    /// Replaces the frame's head pose by a newer sample. Returns the time in ms between the old and the new sample, or
    /// `None` if the runtime has no clock.
    pub fn show_from(&mut self, sample: HeadSample) -> Option<f64> {
        let before = std::mem::replace(&mut self.sampled, sample.at);
        self.head = sample.head;
        before.zip(sample.at).map(|(before, now)| between_ms(before, now))
    }

    /// Returns the refresh period of the display, ms.
    pub fn period_ms(&self) -> f64 {
        self.period_ns as f64 / 1e6
    }

    /// Computes the timing of the frame for a submission at the time `now`. `now` is `None` if the runtime has no
    /// clock.
    pub(super) fn shown(&self, now: Option<Time>) -> Shown {
        let shown = |now| shown_at(self.display, self.period_ns, now);
        Shown {
            ahead_ms: now.map(|now| between_ms(now, self.display)),
            motion_to_photon_ms: now.zip(self.sampled).map(|(now, sampled)| between_ms(sampled, shown(now))),
        }
    }
}

/// Images and panel to show in a frame.
pub struct Picture<'a> {
    /// Colours of both eyes, four bytes per pixel, encoded for the screen.
    pub images: PerView<Pixels>,
    /// Four floats per pixel, the first of which is the distance along the pixel's ray in scene units; 0 is the sky.
    pub distances: Option<PerView<Pixels>>,
    pub metres_per_unit: f64,
    pub panel: Option<&'a Panel>,
}

/// Timing of a submitted frame, if the runtime has a clock.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Time from submission to the predicted display time; negative if the frame was late.
    pub ahead_ms: Option<f64>,
    /// Time from sampling the pose to display: at the predicted time, or for a late frame at the next refresh.
    pub motion_to_photon_ms: Option<f64>,
}
