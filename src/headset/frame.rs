//! A frame in a headset.

use openxr::Time;

use super::input::Input;
use super::pacing::between_ms;
use super::panel::Panel;
use crate::exec::Stereo;
use crate::image::Image;
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
    pub(super) sampled: Option<Time>,
    /// The instant for which it is predicted to be shown, seconds since that of the first frame.
    pub display_s: f64,
    /// Of the display.
    pub period_ms: f64,
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
    /// From when its pose was taken to when it is predicted to be shown, where the runtime tells the time.
    pub fn motion_to_photon_ms(&self) -> Option<f64> {
        self.sampled.map(|sampled| between_ms(sampled, self.display))
    }
}

/// What a frame shows.
pub struct Picture<'a> {
    /// What both eyes see, encoded for the screen.
    pub images: &'a Stereo<Image<[u8; 4]>>,
    /// The distances of that along the rays of pixels, 0 for the sky, in units of so many metres.
    pub distances: Option<(&'a Stereo<Vec<f32>>, f64)>,
    pub panel: Option<&'a Panel>,
}

/// How a frame came to the headset.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// From when it was handed over to when it was predicted to be shown; below 0: it was late.
    pub ahead_ms: Option<f64>,
}
