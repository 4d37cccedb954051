//! Multiplies light by albedo (remodulation) and encodes it for display.

use super::gbuffer::{ALBEDO, EMISSION, TALLY};
use crate::graph::{CutGroup, Image, Kernel, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;

pub const CUT: CutGroup = CutGroup("tonemap");

/// Scene-referred RGB.
pub const LINEAR: Resource = Resource::image("linear", 16).output();
/// Encoded RGBA8.
pub const DISPLAY: Resource = Resource::image("display", 4).output();

/// `light` is demodulated, that is, divided by albedo.
pub fn pass(view: Eye, light: Image) -> Pass {
    Pass::new(Stage("tonemap"), view, CUT, Kernel::new("tonemap")).uses([
        // In a scene without surfaces there is only emitted light.
        Use::read(light).if_written(),
        Use::read(ALBEDO),
        Use::read(EMISSION),
        Use::write(LINEAR),
        Use::write(DISPLAY),
        Use::add(TALLY),
    ])
}
