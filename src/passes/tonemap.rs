//! Remodulation and display encoding.

use super::gbuffer::{ALBEDO, EMISSION, TALLY};
use crate::graph::{CutGroup, Image, Kernel, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;

pub const CUT: CutGroup = CutGroup("tonemap");

/// Scene-referred RGB.
pub const LINEAR: Resource = Resource::image("linear", 16).output();
/// Encoded RGBA8.
pub const DISPLAY: Resource = Resource::image("display", 4).output();

/// `light` is demodulated.
pub fn pass(view: Eye, light: Image) -> Pass {
    Pass::new(Stage("tonemap"), view, CUT, Kernel::new("tonemap")).uses([
        // A scene without surfaces has no light but what is emitted.
        Use::read(light).if_written(),
        Use::read(ALBEDO),
        Use::read(EMISSION),
        Use::write(LINEAR),
        Use::write(DISPLAY),
        Use::add(TALLY),
    ])
}
