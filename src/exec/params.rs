//! The parameters of a frame.

use serde::{Deserialize, Serialize};

use crate::quality::Quality;
use crate::scene::rig::Rig;

/// Everything that a frame depends on beside its scene and the settings of its renderer. [`super::Renderer::frame`] fills in
/// what you do not change. Frames with the same parameters and the same history have the same bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameParams {
    /// The camera, whose path is evaluated at `time_s`.
    pub rig: Rig,
    /// Time on the camera's path and in the scene's animations, seconds.
    pub time_s: f64,
    /// The number of the frame, which keys its random numbers.
    pub index: u32,
    /// The seed of random numbers.
    pub seed: u32,
    pub quality: Quality,
    /// The gaze of the left and the right eye, as fractions of each one's image from the top left. Without it, the gaze is
    /// that of the settings at `time_s`. It has an effect on foveated frames only.
    pub gaze: Option<[[f64; 2]; 2]>,
    /// The camera from which the frame is shown, of one key. Without it, the frame is shown from where it is rendered. It has
    /// an effect with [`crate::stages::StageSettings::is_late`] only.
    pub shown_from: Option<Rig>,
    /// The exposure of displayed images, stops.
    pub exposure_ev: f32,
}
