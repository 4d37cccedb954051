//! `bmfr`: accumulates illumination over frames, fits it to surface features in blocks of pixels, accumulates the
//! result over frames again, and applies TAA.
//!
//! The method is that of Koskela et al. 2019, "Blockwise Multi-Order Feature Regression for Real-Time Path-Tracing
//! Reconstruction", with linearly dependent features dropped as in Xu, Tong & Xu, "Real-Time Path Tracing
//! Reconstruction in DXR".

use glam::UVec4;

use super::svgf::Svgf;
use super::{Denoise, Light, PARTITION, gradient, taa};
use crate::graph::{Chain, Dispatch, Image, Kernel, Pass, Resource, Stage, Use};
use crate::passes::gbuffer::{GUIDE, HIT, TALLY};
use crate::passes::resources::last_surface;
use crate::passes::{FrameSpec, PREVIOUS, tonemap};
use crate::scene::rig::Eye;
use crate::wgsl::{arguments, constants};

/// Accumulated illumination before the fit, with the material and the number of frames.
const ACCUMULATED: Resource = Resource::image::<UVec4>("accumulated");
/// Accumulated illumination after the fit, in the same layout.
const FITTED: Resource = Resource::image::<UVec4>("fitted");

/// Edge length of a block of the fit, in pixels.
const BLOCK: u32 = 32;

const ACCUMULATE: Kernel = Kernel::new("bmfr_accumulate").with(gradient::CONSTANTS);
const FIT: Kernel = Kernel::new("fit").with(constants![BLOCK]).workgroup([256, 1, 1]);

/// Minimum blend weight of the current frame, before and after the fit.
const LEAST_SHARE: f32 = 0.2;
const LEAST_FITTED_SHARE: f32 = 0.1;

arguments! {
    struct BlendArguments {
        /// Minimum blend weight of the current frame.
        pub least_fraction: f32,
    }
}

arguments! {
    struct FitArguments {
        /// Amplitude of the noise that is added to features, 0 to 1.
        pub noise: f32,
    }
}

pub struct Bmfr {
    /// Amplitude of the noise that is added to features, 0 to 1. With 0, dependent features are dropped.
    pub noise: f32,
}

impl Bmfr {
    /// BMFR that drops dependent features.
    pub const DROPPING: Self = Self { noise: 0.0 };
    /// BMFR that adds the noise of the authors' code to features.
    pub const NOISY: Self = Self { noise: 0.01 };
}

/// Returns `pass` with the bindings to blend the current light with the previous frame's `kept` image. Other views
/// fall back to their source's `kept` image.
fn accumulate(spec: &FrameSpec, pass: Pass, light: &mut Light, kept: Resource, least_fraction: f32) -> Pass {
    let last = |resource: Resource| Use::read(resource).before(spec.history_halo());
    let (source, target) = light.advance_to(Image::from(kept));
    let uses = [
        Use::read(HIT),
        Use::read(if spec.moving.is_some() { last_surface(spec) } else { GUIDE }).named("guide_image"),
        Use::read(source).named("source"),
        last(GUIDE),
        last(kept).named("last_accumulated"),
        last(GUIDE).of(pass.view.source()),
        last(kept).of(pass.view.source()).named("left_accumulated"),
        Use::write(target).named("accumulated"),
        Use::read(PREVIOUS),
        Use::add(TALLY),
        gradient::read_change(spec, pass.view),
    ];
    pass.uses(uses).with([BlendArguments { least_fraction }])
}

impl Denoise for Bmfr {
    fn name(&self) -> &'static str {
        if self.noise > 0.0 { "bmfr_noise" } else { "bmfr" }
    }

    fn help(&self) -> Option<&'static str> {
        (self.noise == 0.0).then_some("Temporal regression on surface features, per block")
    }

    fn keeps_history(&self) -> bool {
        true
    }

    /// Returns the image before the fit, whose counts are those of the traced light.
    fn frame_counts(&self) -> Option<Resource> {
        Some(ACCUMULATED)
    }

    fn filters_lobes(&self) -> bool {
        true
    }

    fn leaves_out_narrow_lobes(&self) -> bool {
        true
    }

    /// Returns 1, since the fit is a single iteration.
    fn most_iterations(&self) -> u32 {
        1
    }

    /// Multiplies the estimate for five iterations of svgf by 1.13, the mean ratio of the two denoisers' FLIP over six
    /// scenes at 180 rows and one sample per pixel.
    fn estimated_flip(&self, samples: f64) -> f64 {
        1.13 * Svgf.estimated_blur() * Svgf.estimated_flip(samples)
    }

    fn before(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let pass = Pass::new(Stage("accumulate"), view, PARTITION, ACCUMULATE);
        let pass = accumulate(spec, pass, light, ACCUMULATED, LEAST_SHARE);
        gradient::passes(spec, view).into_iter().chain([pass]).collect()
    }

    /// Returns the pass that fits illumination to surface features. A device processes whole blocks, even those that
    /// cross the edges of its stripe.
    fn filter(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let (source, target) = light.advance();
        let halo = spec.halo(BLOCK - 1);
        let pass = Pass::new(Stage("fit"), view, PARTITION, FIT)
            .uses([
                Use::read(GUIDE).halo(halo),
                Use::read(source).halo(halo).named("source"),
                Use::write(target).named("fitted"),
            ])
            .dispatch(Dispatch::Displaced([BLOCK; 2]))
            .with([FitArguments { noise: self.noise }])
            .chain(Chain::Planned);
        vec![pass]
    }

    fn finish(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let pass = Pass::new(Stage("accumulate_fitted"), view, tonemap::PARTITION, ACCUMULATE);
        let again = accumulate(spec, pass, light, FITTED, LEAST_FITTED_SHARE).chain(Chain::Margin);
        std::iter::once(again).chain(taa::passes(spec, view, light)).collect()
    }
}
