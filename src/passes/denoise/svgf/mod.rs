//! `svgf`: accumulates illumination over frames, filters it with a kernel guided by its variance, and applies TAA.
//!
//! The method is that of Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering".

use glam::UVec4;

use super::{Denoise, Light, PARTITION, gradient, taa};
use crate::graph::{Chain, Image, Kernel, Pass, Resource, Stage, Use};
use crate::passes::gbuffer::{GUIDE, HIT, TALLY};
use crate::passes::resources::last_surface;
use crate::passes::{FrameSpec, PREVIOUS};
use crate::scene::rig::Eye;
use crate::wgsl::{arguments, constants};

const STAGE: Stage = Stage("svgf");
const VARIANCE: Stage = Stage("variance");

/// Statistics of a pixel's accumulated luminance (mean, variance, recent mean, number of samples and number of frames)
/// and the pixel's material, packed.
const MOMENTS: Resource = Resource::image::<UVec4>("moments");
/// Accumulated light after the filter's first iteration.
const HISTORY: Resource = Resource::image::<UVec4>("history");

/// Radius of the spatial estimate of variance, pixels.
const VARIANCE_REACH: u32 = 3;

const VARIANCE_KERNEL: Kernel = Kernel::new("variance").with(constants![VARIANCE_REACH]);

/// Width of the luminance edge-stopping function, in standard deviations of luminance: in the first iteration, whose
/// result becomes the history, and in all others.
const FIRST_SIGMA: f32 = 1.2;
const SIGMA: f32 = 0.8;

/// Returns the distance in pixels between the taps of iteration `index`. It doubles with each iteration, so the first
/// iteration, whose result becomes the history, blurs least.
fn step(index: u32) -> u32 {
    1 << index
}

arguments! {
    struct SvgfArguments {
        /// Distance between taps, pixels.
        pub step: u32,
        /// Squared width of the luminance edge-stopping function.
        pub sigma2: f32,
        pub iteration: u32,
    }
}

pub struct Svgf;

impl Denoise for Svgf {
    fn name(&self) -> &'static str {
        "svgf"
    }

    fn help(&self) -> Option<&'static str> {
        Some("Temporal filter guided by variance")
    }

    fn keeps_history(&self) -> bool {
        true
    }

    fn frame_counts(&self) -> Option<Resource> {
        Some(MOMENTS)
    }

    fn needs_variance(&self) -> bool {
        true
    }

    fn filters_lobes(&self) -> bool {
        true
    }

    fn leaves_finished_light(&self) -> bool {
        true
    }

    /// Evaluates a formula that was fitted to FLIP measured in seven scenes, after some frames of history had
    /// accumulated.
    fn estimated_flip(&self, samples: f64) -> f64 {
        0.08 * samples.powf(-0.25)
    }

    /// Returns the mean over the same scenes. Single ones have 0.84 to 1.14.
    fn estimated_blur(&self) -> f64 {
        0.96
    }

    /// Returns the passes that blend this frame's light with its history. Other views fall back to their source's
    /// history.
    fn before(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let last = |resource| Use::read(resource).before(spec.history_halo());
        let (traced, accumulated) = light.advance();
        let pass = Pass::new(Stage("accumulate"), view, PARTITION, Kernel::new("accumulate").with(gradient::CONSTANTS))
            .uses([
                Use::read(HIT),
                Use::read(if spec.moving.is_some() { last_surface(spec) } else { GUIDE }).named("guide_image"),
                Use::read(traced).named("radiance"),
                last(GUIDE),
                last(MOMENTS),
                last(HISTORY),
                last(GUIDE).of(view.source()),
                last(MOMENTS).of(view.source()),
                last(HISTORY).of(view.source()),
                Use::write(accumulated).named("accumulated"),
                Use::write(MOMENTS),
                Use::read(PREVIOUS),
                Use::add(TALLY),
                gradient::read_change(spec, view),
            ]);
        gradient::passes(spec, view).into_iter().chain([pass]).collect()
    }

    fn filter(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let link = |stage, kernel, reach_rows: u32, (source, target): (Image, Image)| {
            let halo = spec.halo(reach_rows);
            let uses = [
                Use::read(GUIDE).halo(halo),
                Use::read(source).halo(halo).named("source"),
                Use::write(target).named("filtered"),
            ];
            Pass::new(stage, view, PARTITION, kernel).uses(uses).chain(Chain::Planned)
        };
        let mut passes = vec![link(VARIANCE, VARIANCE_KERNEL, VARIANCE_REACH, light.advance())];
        for index in 0..spec.iterations {
            let images = if index == 0 { light.advance_to(HISTORY.into()) } else { light.advance() };
            let sigma = if index == 0 { FIRST_SIGMA } else { SIGMA };
            let arguments = SvgfArguments { step: step(index), sigma2: sigma * sigma, iteration: index };
            passes.push(link(STAGE, Kernel::new("svgf"), step(index), images).index(index).with([arguments]));
        }
        passes
    }

    fn finish(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        taa::passes(spec, view, light)
    }
}
