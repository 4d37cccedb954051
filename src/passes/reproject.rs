//! Spatial reprojection of the left eye into the right, and the list of holes.

use super::FrameSpec;
use super::gbuffer::{GUIDE, HIT, TALLY};
use super::path_trace::RADIANCE;
use super::tally::HoleReason;
use crate::graph::{CutGroup, Kernel, Pass, Resource, Stage, Use};
use crate::scene::rig::Eye;

pub const CUT: CutGroup = CutGroup("reproject");

/// The pixels that are to be path traced.
pub const HOLES: Resource = Resource::list("holes");

const fn code(reason: HoleReason) -> u32 {
    reason as u32 + 1
}

/// Of the rows of polar images, one over the share that may lie between where the eyes see a surface.
const POLAR_REACH: u32 = 8;

const KERNEL: Kernel = Kernel::new("reproject").with(&[
    ("OUTSIDE", code(HoleReason::Outside)),
    ("NORMAL", code(HoleReason::Normal)),
    ("DISTANCE", code(HoleReason::Distance)),
    ("MATERIAL", code(HoleReason::Material)),
    ("MIXED", code(HoleReason::Mixed)),
    ("VIEW", code(HoleReason::View)),
]);

pub fn pass(spec: &FrameSpec) -> Pass {
    let reach = if spec.screen.is_some() { spec.extent.height.div_ceil(POLAR_REACH) } else { 0 };
    let left = |image| Use::read(image).of(Eye::Left).halo(spec.halo(reach));
    Pass::new(Stage("reproject"), Eye::Right, CUT, KERNEL)
        .uses([
            left(HIT),
            left(GUIDE),
            left(RADIANCE),
            Use::read(HIT),
            Use::read(GUIDE),
            Use::write(RADIANCE),
            Use::update(TALLY),
            Use::write_then_read(HOLES).cleared(),
        ])
        .args([reach, 0, 0])
}
