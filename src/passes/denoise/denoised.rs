//! The passes that a denoiser declares for one view.

use super::method::{Denoise, Light};
use crate::graph::{Image, Pass};
use crate::passes::{FrameSpec, reproject};
use crate::scene::rig::Eye;

/// The passes of a denoiser on one view, and the image of filtered illumination.
pub struct Denoised {
    pub view: Eye,
    pub before: Vec<Pass>,
    /// The pass that takes over the other eye's filtered light, between the passes before the filter and the filter.
    pub taken_over: Option<Pass>,
    pub filter: Vec<Pass>,
    pub light: Light,
}

impl Denoised {
    /// `left_light` is the left eye's filtered light, if this eye takes it over.
    pub fn new(denoiser: &dyn Denoise, spec: &FrameSpec, view: Eye, left_light: Option<Image>) -> Self {
        let mut light = Light::traced();
        let before = denoiser.before(spec, view, &mut light);
        let taken_over = left_light.map(|left_light| reproject::filtered(spec, left_light, &mut light));
        let filter = denoiser.filter(spec, view, &mut light);
        Self { view, before, taken_over, filter, light }
    }
}
