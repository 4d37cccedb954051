//! Frames of other renderers: the caller gives surfaces and light, and one pass writes the images that the G-buffer and
//! path tracing write otherwise. The passes of the denoiser follow unchanged.

use glam::Vec4;

use super::{Denoised, of};
use crate::graph::{Kernel, Life, Pass, Resource, Stage, Use};
use crate::passes::FrameSpec;
use crate::passes::gbuffer::{ALBEDO, EMISSION, GUIDE, HIT, PARTITION, TALLY};
use crate::passes::resources::{RADIANCE, last_surface};
use crate::scene::rig::Eye;

/// Radiance in linear RGB.
pub const COLOR: Resource = input("imported_color");
/// The part of the radiance that the surface or the sky emits, which no pass filters.
pub const EMITTED: Resource = input("imported_emission");
/// Fraction of uniform light that the surface reflects, by which radiance is demodulated.
pub const REFLECTANCE: Resource = input("imported_albedo");
/// Shading normal in world space; 0 without a surface.
pub const NORMAL: Resource = input("imported_normal");
/// Position in world space.
pub const POSITION: Resource = input("imported_position");

/// Position of the surface in the previous frame, in world space. In frames without motion, the image has one texel and
/// is not read.
pub fn last_position(spec: &FrameSpec) -> Resource {
    input("imported_last_position").on(last_surface(spec).grid)
}

/// Four floats per pixel, of which the last one is padding.
const fn input(name: &'static str) -> Resource {
    Resource { life: Life::Input, ..Resource::image::<Vec4>(name) }
}

const KERNEL: Kernel = Kernel::new("import");

fn pass(spec: &FrameSpec, view: Eye) -> Pass {
    let inputs = [COLOR, EMITTED, REFLECTANCE, NORMAL, POSITION, last_position(spec)].map(Use::read);
    let outputs = [HIT, GUIDE, ALBEDO, EMISSION, RADIANCE, TALLY].map(Use::write);
    let last_surface = Use::write(last_surface(spec)).named("last_surface_image");
    Pass::new(Stage("import"), view, PARTITION, KERNEL).uses(inputs).uses(outputs).uses([last_surface])
}

/// Returns the passes of a frame whose surfaces and light are given.
pub fn passes(spec: &FrameSpec) -> Vec<Pass> {
    let denoiser = of(spec.denoiser());
    let of_view = |view| {
        let Denoised { before, filter, mut light, .. } = Denoised::new(denoiser, spec, view, None);
        [vec![pass(spec, view)], before, filter, denoiser.finish(spec, view, &mut light)].concat()
    };
    spec.eyes().flat_map(of_view).collect()
}
