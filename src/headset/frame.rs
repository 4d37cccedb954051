//! A frame in a headset.

use openxr::Time;

use super::drawing::Pixels;
use super::input::Input;
use super::pacing::{between_ms, shown_at};
use super::panel::Panel;
use super::sample::HeadSample;
use crate::exec::Stereo;
use crate::scene::head::HeadPose;
use crate::scene::optics::HeadEyes;

/// What the headset wants next.
#[derive(Debug)]
pub enum Next {
    /// A frame, which is to be rendered and shown.
    Frame(Box<HeadsetFrame>),
    /// Nobody sees a frame now.
    Idle,
    Ended,
}

/// A frame that has begun.
#[derive(Clone, Copy, Debug)]
pub struct HeadsetFrame {
    pub(super) display: Time,
    pub(super) period_ns: i64,
    pub(super) sampled: Option<Time>,
    /// The instant for which it is predicted to be shown, seconds since that of the first frame.
    pub display_s: f64,
    /// Where the head will be then, in the session's space.
    pub head: HeadPose,
    pub eyes: HeadEyes,
    /// Periods of the display without a frame since the one before.
    pub missed: u32,
    pub input: Input,
    /// Where the eyes look, a fraction of each one's image from the top left, once a tracker has told it.
    pub gaze: Option<[[f64; 2]; 2]>,
}

impl HeadsetFrame {
    /// It is shown from there; returns how much newer that is, ms, where the runtime tells the time.
    pub fn show_from(&mut self, sample: HeadSample) -> Option<f64> {
        let before = std::mem::replace(&mut self.sampled, sample.at);
        self.head = sample.head;
        before.zip(sample.at).map(|(before, now)| between_ms(before, now))
    }

    /// Of the display.
    pub fn period_ms(&self) -> f64 {
        self.period_ns as f64 / 1e6
    }

    /// How it came to the headset, if it is handed over now.
    pub(super) fn shown(&self, now: Option<Time>) -> Shown {
        let shown = |now| shown_at(self.display, self.period_ns, now);
        Shown {
            ahead_ms: now.map(|now| between_ms(now, self.display)),
            motion_to_photon_ms: now.zip(self.sampled).map(|(now, sampled)| between_ms(sampled, shown(now))),
        }
    }
}

/// What a frame shows.
pub struct Picture<'a> {
    /// What both eyes see, four bytes a pixel, encoded for the screen.
    pub images: Stereo<Pixels>,
    /// The distance of that along the ray of each pixel, in scene units, the first of four floats; 0: sky.
    pub distances: Option<Stereo<Pixels>>,
    pub metres_per_unit: f64,
    pub panel: Option<&'a Panel>,
}

/// How a frame came to the headset, where the runtime tells the time.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// From when it was handed over to when it was predicted to be shown; below 0: it was late.
    pub ahead_ms: Option<f64>,
    /// From when the pose was taken that it is shown from to when it is: as predicted, or if it was late, at the first of the
    /// display's next times.
    pub motion_to_photon_ms: Option<f64>,
}
