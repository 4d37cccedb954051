//! Spatial reprojection of the left eye into the right, and the compacted list of the pixels that it cannot fill.

use super::FrameSpec;
use super::denoise::{self, Light};
use super::gbuffer::{ALBEDO, GUIDE, HIT, TALLY};
use super::resources::{HOLES, RADIANCE};
use super::tally::HoleReason;
use crate::graph::{Image, Kernel, Partition, Pass, Stage, Use};
use crate::scene::rig::Eye;

pub const PARTITION: Partition = Partition("reproject");

const fn code(reason: HoleReason) -> u32 {
    reason as u32 + 1
}

/// Divisor that gives the search range of reprojection in polar images, where a surface may lie on different rows in
/// the two eyes: the search covers image height / `POLAR_REACH` rows above and below.
const POLAR_REACH: u32 = 8;

const REASONS: &[(&str, u32)] = &[
    ("OUTSIDE", code(HoleReason::Outside)),
    ("NORMAL", code(HoleReason::Normal)),
    ("DISTANCE", code(HoleReason::Distance)),
    ("MATERIAL", code(HoleReason::Material)),
    ("MIXED", code(HoleReason::Mixed)),
    ("VIEW", code(HoleReason::View)),
];

/// Returns the number of rows above and below its own in which a pixel's surface may lie in the left eye.
fn reach(spec: &FrameSpec) -> u32 {
    if spec.chain.polar.is_some() { spec.extent.height.div_ceil(POLAR_REACH) } else { 0 }
}

/// Returns the pass that replaces the right eye's light by the left eye's filtered light, `left_light`, wherever the eyes
/// see the same surface.
pub fn filtered(spec: &FrameSpec, left_light: Image, light: &mut Light) -> Pass {
    let left = |image: Image| Use::read(image).of(Eye::Left).halo(spec.halo(reach(spec)));
    let (source, target) = light.advance();
    Pass::new(
        Stage("reproject_filtered"),
        Eye::Right,
        denoise::PARTITION,
        Kernel::new("reproject_filtered").with(REASONS),
    )
    .uses([
        left(HIT.into()),
        left(GUIDE.into()),
        left(left_light).named("left_light"),
        Use::read(HIT),
        Use::read(GUIDE),
        Use::read(ALBEDO),
        Use::read(TALLY),
        Use::read(source).named("source"),
        Use::write(target).named("filtered"),
    ])
    .args([reach(spec), 0, 0])
}

pub fn pass(spec: &FrameSpec) -> Pass {
    let reach = reach(spec);
    let left = |image| Use::read(image).of(Eye::Left).halo(spec.halo(reach));
    Pass::new(Stage("reproject"), Eye::Right, PARTITION, Kernel::new("reproject").with(REASONS))
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
