//! Remodulation of filtered illumination, and temporal antialiasing (TAA) of the result.

use glam::Vec4;

use super::{Light, gradient};
use crate::graph::{Chain, Kernel, Pass, Resource, Stage, Use};
use crate::passes::gbuffer::{ALBEDO, EMISSION, GUIDE, TALLY};
use crate::passes::resources::last_surface;
use crate::passes::tonemap::{PARTITION, finished};
use crate::passes::{FrameSpec, PREVIOUS};
use crate::scene::rig::Eye;

/// Result of TAA: scene-referred RGB, and the number of accumulated frames.
const RESOLVED: Resource = Resource::image::<Vec4>("resolved");

/// Number of rows above and below a device's stripe that TAA reads.
const RESOLVE_REACH_ROWS: u32 = 1;

/// Returns two passes. `compose` multiplies illumination by albedo (remodulation) and adds emission, also in the rows
/// around a device's stripe that TAA reads. `resolve` applies TAA.
pub fn passes(spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
    let (filtered, composed) = light.advance();
    // Surfaces of the previous frame, which validate history in dynamic scenes.
    let last_guide = match spec.moving.is_some() {
        true => Use::read(GUIDE).before(spec.history_halo()),
        false => Use::read(last_surface(spec)).if_written().named("last_guide"),
    };
    let [linear, display] = finished(spec);
    let compose = Pass::new(Stage("compose"), view, PARTITION, Kernel::new("compose"))
        .uses([
            Use::read(filtered).named("radiance"),
            Use::read(ALBEDO),
            Use::read(EMISSION),
            Use::write(composed).named("composed").viewed_as::<Vec4>(),
        ])
        .chain(Chain::Margin);
    let resolve = Pass::new(Stage("resolve"), view, PARTITION, Kernel::new("taa").with(gradient::CONSTANTS))
        .uses([
            Use::read(composed).halo(spec.halo(RESOLVE_REACH_ROWS)).named("composed").viewed_as::<Vec4>(),
            Use::read(RESOLVED).before(spec.history_halo()),
            Use::write(RESOLVED),
            Use::write(linear).named("linear"),
            Use::write(display).named("display"),
            Use::read(PREVIOUS),
            Use::add(TALLY),
            Use::read(last_surface(spec)).halo(spec.halo(RESOLVE_REACH_ROWS)).if_written(),
            last_guide,
            gradient::read_change(spec, view),
        ])
        .chain(Chain::Margin);
    vec![compose, resolve]
}
