//! Multiplies light by albedo (remodulation) and encodes it for display.

use super::gbuffer::{ALBEDO, EMISSION, TALLY};
use super::resources::{POLAR, POLAR_DISPLAY, RECTIFIED, RECTIFIED_DISPLAY};
use super::{Display, FrameSpec};
use crate::graph::{Image, Kernel, Partition, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;

pub use super::resources::{DISPLAY, LINEAR};

pub const PARTITION: Partition = Partition("tonemap");

/// Returns the images that tonemapping or TAA writes: as scene-referred RGB, and encoded for display. Later passes map
/// polar images to the screen, and resample rectified images for display.
pub fn finished(spec: &FrameSpec) -> [Resource; 2] {
    match (spec.chain.polar, spec.chain.display) {
        (Some(_), _) => [POLAR, POLAR_DISPLAY],
        (None, Display::Resampled { .. }) => [RECTIFIED, RECTIFIED_DISPLAY],
        (None, Display::Direct) => [LINEAR, DISPLAY],
    }
}

/// Returns the tonemapping pass of a view. `light` is demodulated illumination, that is, radiance divided by albedo.
pub fn pass(spec: &FrameSpec, view: Eye, light: Image) -> Pass {
    let [linear, display] = finished(spec);
    Pass::new(Stage("tonemap"), view, PARTITION, Kernel::new("tonemap")).uses([
        // In a scene without surfaces there is only emitted light.
        Use::read(light).if_written().named("radiance"),
        Use::read(ALBEDO),
        Use::read(EMISSION),
        Use::write(linear).named("linear"),
        Use::write(display).named("display"),
        Use::add(TALLY),
    ])
}
