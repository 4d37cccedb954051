//! Denoisers, which come between traced light and the image.

mod antialias;
mod atrous;
mod bmfr;
mod gradient;
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

/// The image that holds light, on its way through passes that each read one image and write the next. Light is
/// demodulated: it is reflected light over albedo.
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

    /// The image that holds light now.
    pub fn image(self) -> Image {
        self.current
    }

    /// The image that a pass reads light from, and the one that it writes it to.
    pub fn advance(&mut self) -> (Image, Image) {
        self.filtered = self.filtered.next();
        self.advance_to(self.filtered)
    }

    /// Like [`Self::advance`], but the pass writes to `target`.
    pub fn advance_to(&mut self, target: Image) -> (Image, Image) {
        (std::mem::replace(&mut self.current, target), target)
    }
}

/// The passes of a denoiser on one view.
pub trait Denoise {
    /// The passes before the filter.
    fn before(&self, _spec: &FrameSpec, _view: Eye, _light: &mut Light) -> Vec<Pass> {
        Vec::new()
    }

    /// The passes of the filter. Each reads rows around its own from what the one before wrote, and the halo plan says
    /// before which of them rows are received.
    fn filter(&self, _spec: &FrameSpec, _view: Eye, _light: &mut Light) -> Vec<Pass> {
        Vec::new()
    }

    /// The passes from light to the images that leave the frame.
    fn finish(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        vec![tonemap::pass(spec, view, light.image())]
    }
}

/// No denoiser. Light stays as it was traced.
struct Undenoised;

impl Denoise for Undenoised {}

/// The passes of this denoiser.
pub fn of(denoiser: Option<Denoiser>) -> Box<dyn Denoise> {
    match denoiser {
        None => Box::new(Undenoised),
        Some(Denoiser::Atrous) => Box::new(atrous::Atrous),
        Some(Denoiser::Svgf) => Box::new(svgf::Svgf),
        Some(Denoiser::Bmfr) => Box::new(bmfr::Bmfr::DROPPING),
        Some(Denoiser::BmfrNoise) => Box::new(bmfr::Bmfr::NOISY),
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
