//! `svgf`: accumulates illumination over frames, filters it with a kernel guided by its variance, and applies TAA.
//!
//! The method is that of Schied et al. 2017, "Spatiotemporal Variance-Guided Filtering".

use glam::UVec4;

use super::{Denoise, Light, PARTITION, gradient, taa};
use crate::graph::{Chain, Dispatch, Image, Kernel, Pass, Resource, Stage, Use};
use crate::passes::gbuffer::{GUIDE, HIT, TALLY};
use crate::passes::resources::last_surface;
use crate::passes::{FrameSpec, PREVIOUS};
use crate::scene::rig::Eye;
use crate::wgsl::{arguments, constants};

const STAGE: Stage = Stage("svgf");
const VARIANCE: Stage = Stage("variance");
const SELECT: Stage = Stage("select_unfinished");

/// Statistics of a pixel's accumulated luminance (mean, variance, recent mean, number of samples and number of frames)
/// and the pixel's material, packed.
const MOMENTS: Resource = Resource::image::<UVec4>("moments");
/// Accumulated light after the filter's first iteration.
const HISTORY: Resource = Resource::image::<UVec4>("history");

/// Compacted list of the pixels that the filter has to do if the others take over filtered light.
const UNFINISHED: Resource = Resource::list("unfinished");

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
    struct VarianceArguments {
        /// 0 to filter all pixels; n to filter the nth part of the listed ones. A part is as large as a dispatch may be.
        pub list_part: u32,
    }
}

arguments! {
    struct SvgfArguments {
        /// 0 for all pixels, n for the nth part of the listed ones, as in `VarianceArguments`.
        pub list_part: u32,
        /// Squared width of the luminance edge-stopping function.
        pub sigma2: f32,
        pub iteration: u32,
    }
}

/// Returns the pass that lists the pixels without finished light, and copies the finished ones to the images that the
/// filter writes.
fn select_unfinished(view: Eye, light: Image, copies: [Image; 2]) -> Pass {
    let [copy, history] = copies.map(Use::write);
    Pass::new(SELECT, view, PARTITION, Kernel::new("select_unfinished"))
        .uses([
            Use::read(GUIDE),
            Use::read(light).named("source"),
            copy.named("filtered"),
            history,
            Use::write_then_read(UNFINISHED).cleared().named("new_list"),
        ])
        .chain(Chain::Margin)
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

    /// Returns the passes of the filter, which alternate between two images. If a part of the light is finished, they run
    /// on the list of the other pixels, and both images have the finished ones.
    fn filter(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let is_listed = light.is_partly_finished();
        let (target, dispatch, parts) = match is_listed {
            true => {
                (Use::update as fn(Image) -> Use, Dispatch::List(UNFINISHED), 1..=UNFINISHED.list_parts(spec.extent))
            }
            false => (Use::write as fn(Image) -> Use, Dispatch::PIXELS, 0..=0),
        };
        let link = |stage, kernel, reach_rows: u32, (from, to): (Image, Image)| {
            let halo = spec.halo(reach_rows);
            let uses = [
                Use::read(GUIDE).halo(halo),
                Use::read(from).halo(halo).named("source"),
                target(to).named("filtered"),
                Use::read(UNFINISHED).if_written().named("listed"),
            ];
            Pass::new(stage, view, PARTITION, kernel).uses(uses).dispatch(dispatch).chain(Chain::Planned)
        };
        let mut passes = Vec::new();
        let images = light.advance();
        if is_listed {
            passes.push(select_unfinished(view, images.0, [images.1, HISTORY.into()]));
        }
        let variance = link(VARIANCE, VARIANCE_KERNEL, VARIANCE_REACH, images);
        passes.push(variance.with(parts.clone().map(|list_part| VarianceArguments { list_part })));
        for index in 0..spec.iterations {
            let images = match index {
                0 => light.advance_to(HISTORY.into()),
                _ if index % 2 == 1 => light.advance_to(images.0),
                _ => light.advance_to(images.1),
            };
            let sigma = if index == 0 { FIRST_SIGMA } else { SIGMA };
            let of_part = |list_part| SvgfArguments { list_part, sigma2: sigma * sigma, iteration: index };
            let pass = link(STAGE, Kernel::new("svgf"), step(index), images).index(index);
            passes.push(pass.with(parts.clone().map(of_part)));
        }
        passes
    }

    fn finish(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        taa::passes(spec, view, light)
    }
}
