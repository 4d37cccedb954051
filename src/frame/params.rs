//! The parameters of a frame.

use serde::{Deserialize, Serialize};

use crate::quality::Quality;
use crate::scene::rig::Rig;
use crate::schedule::RelativeCost;

/// Parameters that determine a frame, together with its scene and the configuration of its renderer.
/// [`Renderer::frame`](crate::exec::Renderer::frame) fills in defaults. Frames with the same parameters and the same
/// history are byte-identical.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameParams {
    /// The camera, whose path is evaluated at `time_s`.
    pub rig: Rig,
    /// Time on the camera's path and in the scene's animations, in seconds.
    pub time_s: f64,
    /// The number of the frame, which keys its random numbers.
    pub index: u32,
    /// The seed of random numbers.
    pub seed: u32,
    pub quality: Quality,
    /// Gaze of the left and the right eye, in fractions of each eye's image from the top left. Only foveated frames
    /// depend on it.
    pub gaze: [[f64; 2]; 2],
    /// Later camera, with a single key, that the displayed image is reprojected to. `None` displays the frame from its
    /// own pose. Used only if [`crate::passes::Display::is_late`].
    pub shown_from: Option<Rig>,
    /// Exposure of displayed images, in stops. No other image depends on it.
    pub exposure_ev: f32,
    /// Cost of the frame's stages relative to frames of other quality, with which the cost model compares them. No image
    /// depends on it.
    #[serde(skip)]
    pub relative_cost: RelativeCost,
}
