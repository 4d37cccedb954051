//! The passes that a denoiser declares for one view.

use super::method::{Denoise, Light};
use crate::graph::Pass;
use crate::passes::FrameSpec;
use crate::scene::rig::Eye;

/// The passes of a denoiser on one view, and the image of filtered illumination.
pub struct Denoised {
    pub view: Eye,
    pub before: Vec<Pass>,
    pub filter: Vec<Pass>,
    pub light: Light,
}

impl Denoised {
    pub fn new(denoiser: &dyn Denoise, spec: &FrameSpec, view: Eye) -> Self {
        let mut light = Light::traced();
        let before = denoiser.before(spec, view, &mut light);
        let filter = denoiser.filter(spec, view, &mut light);
        Self { view, before, filter, light }
    }
}
