//! Spatial reprojection of the left eye into the right, and the compacted list of the pixels that it cannot fill.

use super::FrameSpec;
use super::gbuffer::{GUIDE, HIT, TALLY};
use super::resources::{HOLES, RADIANCE};
use super::tally::HoleReason;
use crate::graph::{Kernel, Partition, Pass, Stage, Use};
use crate::scene::rig::Eye;

pub const PARTITION: Partition = Partition("reproject");

const fn code(reason: HoleReason) -> u32 {
    reason as u32 + 1
}

/// Divisor that gives the search range of reprojection in polar images, where a surface may lie on different rows in
/// the two eyes: the search covers image height / `POLAR_REACH` rows above and below.
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
    let reach = if spec.chain.polar.is_some() { spec.extent.height.div_ceil(POLAR_REACH) } else { 0 };
    let left = |image| Use::read(image).of(Eye::Left).halo(spec.halo(reach));
    Pass::new(Stage("reproject"), Eye::Right, PARTITION, KERNEL)
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
