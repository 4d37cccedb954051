//! The passes that a denoiser declares for one view.

use super::method::{Denoise, Light};
use crate::graph::{Image, Pass};
use crate::passes::{FrameSpec, reproject};
use crate::scene::rig::Eye;

/// The passes of a denoiser on one view, and the image of filtered illumination.
pub struct Denoised {
    pub view: Eye,
    pub before: Vec<Pass>,
    /// The pass that takes over the filtered light of the view's source, between the passes before the filter and the
    /// filter.
    pub taken_over: Option<Pass>,
    pub filter: Vec<Pass>,
    pub light: Light,
}

impl Denoised {
    /// `source_light` is the filtered light of the view's source, if this view takes it over.
    pub fn new(denoiser: &dyn Denoise, spec: &FrameSpec, view: Eye, source_light: Option<Image>) -> Self {
        let mut light = Light::traced();
        let before = denoiser.before(spec, view, &mut light);
        let taken_over = source_light.map(|from| reproject::filtered(spec, view, from, &mut light));
        let filter = denoiser.filter(spec, view, &mut light);
        Self { view, before, taken_over, filter, light }
    }
}
