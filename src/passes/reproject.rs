//! Spatial reprojection of a view from its source, the holes that it shares with other views, and the compacted lists of
//! the pixels that stay empty.

use super::FrameSpec;
use super::denoise::{self, Light};
use super::gbuffer::{ALBEDO, GUIDE, HIT, TALLY};
use super::resources::{HOLES, RADIANCE, UNSHARED};
use super::tally::HoleReason;
use crate::graph::{Dispatch, Image, Kernel, Partition, Pass, Stage, Use};
use crate::scene::rig::Eye;
use crate::wgsl::arguments;

pub const PARTITION: Partition = Partition("reproject");

const fn code(reason: HoleReason) -> u32 {
    reason as u32 + 1
}

/// Divisor that gives the search range of reprojection in polar images, where a surface may lie on different rows in
/// the two eyes: the search covers image height / `POLAR_REACH` rows above and below.
const POLAR_REACH: u32 = 8;

pub(super) const REASONS: &[(&str, u32)] = &[
    ("OUTSIDE", code(HoleReason::Outside)),
    ("NORMAL", code(HoleReason::Normal)),
    ("DISTANCE", code(HoleReason::Distance)),
    ("MATERIAL", code(HoleReason::Material)),
    ("MIXED", code(HoleReason::Mixed)),
    ("VIEW", code(HoleReason::View)),
];

arguments! {
    pub(super) struct ReachArguments {
        /// Rows above and below its own in which a pixel's surface may lie in the source.
        pub reach: u32,
    }
}

/// Returns the number of rows above and below its own in which a pixel's surface may lie in the source.
pub(super) fn reach(spec: &FrameSpec) -> u32 {
    if spec.chain.polar.is_some() { spec.extent.height.div_ceil(POLAR_REACH) } else { 0 }
}

/// Returns the binding of an image of the view from which `view` is reprojected.
pub(super) fn of_source(spec: &FrameSpec, view: Eye, image: impl Into<Image>) -> Use {
    seen_in(spec, view.source(), image)
}

/// Returns the binding of an image of a view in which surfaces are looked up.
fn seen_in(spec: &FrameSpec, view: Eye, image: impl Into<Image>) -> Use {
    Use::read(image).of(view).halo(spec.halo(reach(spec)))
}

/// Returns the pass that replaces a view's light by the filtered light of its source, `source_light`, wherever both see
/// the same surface.
pub fn filtered(spec: &FrameSpec, view: Eye, source_light: Image, light: &mut Light) -> Pass {
    let (source, target) = light.finish_part();
    let kernel = Kernel::new("reproject_filtered").with(REASONS);
    Pass::new(Stage("reproject_filtered"), view, denoise::PARTITION, kernel)
        .uses([
            of_source(spec, view, HIT),
            of_source(spec, view, GUIDE),
            of_source(spec, view, source_light).named("left_light"),
            Use::read(HIT),
            Use::read(GUIDE),
            Use::read(ALBEDO),
            Use::read(TALLY),
            Use::read(source).named("source"),
            Use::write(target).named("filtered"),
        ])
        .with([ReachArguments { reach: reach(spec) }])
}

pub fn pass(spec: &FrameSpec, view: Eye) -> Pass {
    Pass::new(Stage("reproject"), view, PARTITION, Kernel::new("reproject").with(REASONS))
        .uses([
            of_source(spec, view, HIT),
            of_source(spec, view, GUIDE),
            of_source(spec, view, RADIANCE),
            Use::read(HIT),
            Use::read(GUIDE),
            Use::write(RADIANCE),
            Use::update(TALLY),
            Use::write_then_read(HOLES).cleared().named("new_list"),
        ])
        .with([ReachArguments { reach: reach(spec) }])
}

arguments! {
    struct SharedArguments {
        /// Rows above and below its own in which a pixel's surface may lie in the partner.
        pub reach: u32,
        /// n to look up the nth part of the list of holes. A part is as large as a dispatch may be.
        pub list_part: u32,
    }
}

/// Returns the pass that takes over the light of a view's holes from its partner, which has traced it.
pub fn share_holes(spec: &FrameSpec, view: Eye, partner: Eye) -> Pass {
    let of_part = |list_part| SharedArguments { reach: reach(spec), list_part };
    let kernel = Kernel::new("share_holes").workgroup([8, 4, 1]).with(REASONS);
    Pass::new(Stage("share_holes"), view, PARTITION, kernel)
        .uses([
            seen_in(spec, partner, HIT).named("left_hit"),
            seen_in(spec, partner, GUIDE).named("left_guide"),
            seen_in(spec, partner, RADIANCE).named("left_radiance"),
            Use::read(HIT),
            Use::read(GUIDE),
            Use::update(RADIANCE),
            Use::update(TALLY),
            Use::read(HOLES).named("listed"),
            Use::write_then_read(UNSHARED).cleared().named("new_list"),
        ])
        .dispatch(Dispatch::List(HOLES))
        .with((1..=HOLES.list_parts(spec.extent)).map(of_part))
}
