//! Denoisers: what comes between traced light and the image.

mod atrous;
pub mod seam_filter;
mod svgf;

use super::path_trace::RADIANCE;
use super::{FrameSpec, tonemap};
use crate::graph::{CutGroup, Image, Pass, Resource};
use crate::quality::Denoiser;
use crate::scene::rig::Eye;

/// The stripes of all denoisers' passes.
pub const CUT: CutGroup = CutGroup("atrous");

const FILTERED: Resource = Resource::image("filtered", 16);

/// Light on its way through passes that each read one image and write the next. It is demodulated: reflected light over
/// albedo.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    current: Image,
    /// The version of the filtered image that was written last.
    filtered: Image,
}

impl Light {
    fn traced() -> Self {
        Self { current: RADIANCE.into(), filtered: FILTERED.into() }
    }

    /// Where it is.
    pub fn image(self) -> Image {
        self.current
    }

    /// Where a pass reads it, and where it leaves it.
    pub fn advance(&mut self) -> (Image, Image) {
        self.filtered = self.filtered.next();
        self.advance_to(self.filtered)
    }

    /// ... in an image of its own.
    pub fn advance_to(&mut self, target: Image) -> (Image, Image) {
        (std::mem::replace(&mut self.current, target), target)
    }
}

/// The passes of a denoiser on one view.
pub trait Denoise {
    /// What comes before the filter.
    fn before(&self, _spec: &FrameSpec, _view: Eye, _light: &mut Light) -> Vec<Pass> {
        Vec::new()
    }

    /// The filter: passes that each read rows around their own of what the one before wrote. Before which of them rows are
    /// received, the halo plan says.
    fn filter(&self, _spec: &FrameSpec, _view: Eye, _light: &mut Light) -> Vec<Pass> {
        Vec::new()
    }

    /// From light to the images that leave the frame.
    fn finish(&self, _spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        vec![tonemap::pass(view, light.image())]
    }
}

/// No denoiser: light as it was traced.
struct Undenoised;

impl Denoise for Undenoised {}

/// The passes of this denoiser.
pub fn of(denoiser: Option<Denoiser>) -> Box<dyn Denoise> {
    match denoiser {
        None => Box::new(Undenoised),
        Some(Denoiser::Atrous) => Box::new(atrous::Atrous),
        Some(Denoiser::Svgf) => Box::new(svgf::Svgf),
    }
}

/// The passes of a denoiser on one view up to the light that it leaves.
pub(super) struct Denoised {
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
