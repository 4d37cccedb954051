//! Path traces one view in batches of samples: all its pixels, or those that an earlier pass listed.

use super::FrameSpec;
use super::gbuffer::{ALBEDO, EMISSION, GUIDE, HIT, TALLY};
use super::radiance_cache::{self, RECORD_SEGMENT, RECORD_WORDS};
use super::reproject::PARTITION as REPROJECT;
use super::resources::{HOLES, UNSHARED};
use crate::graph::{Dispatch, Kernel, Launch, Partition, Pass, Resource, Stage, Use, Work};
use crate::scene::rig::Eye;
use crate::wgsl::{arguments, constants};

pub use super::resources::RADIANCE;

pub const STAGE: Stage = Stage("path_trace");
pub const HOLE_FILL: Stage = Stage("hole_fill");
pub const PARTITION: Partition = Partition("path_trace");

/// Paths per pixel in one launch. Mesa's software driver ends all loops of an invocation after 65,535 iterations in
/// total, and a path of 13 rays takes some thousands. Short launches also satisfy drivers that abort long dispatches.
const PATHS_PER_LAUNCH: u32 = 4;

arguments! {
    struct PathArguments {
        /// The samples of a launch: the first, and the one after the last.
        pub first_sample: u32,
        pub end_sample: u32,
        /// 0 to trace all pixels; n to trace the nth part of those that an earlier pass listed. A part is as large as a
        /// dispatch may be.
        pub list_part: u32,
    }
}

/// Kernel that both stages share, since drivers take seconds to compile it.
const KERNEL: Kernel = Kernel::tracing_rays("path_trace").with(constants![RECORD_SEGMENT, RECORD_WORDS]);

fn trace(spec: &FrameSpec, stage: Stage, view: Eye, partition: Partition, list: Option<Resource>) -> Pass {
    let (radiance, dispatch, parts) = match list {
        Some(list) => (Use::update(RADIANCE), Dispatch::List(list), 1..=list.list_parts(spec.extent)),
        None => (Use::write_then_read(RADIANCE), Dispatch::PIXELS, 0..=0),
    };
    let listed = Use::read(list.unwrap_or(HOLES)).if_written().named("listed");
    let launch = |third| Launch::Samples { most: PATHS_PER_LAUNCH, third, only_jittered: false };
    let [hit, albedo] = [HIT, ALBEDO].map(Use::update);
    // Unfiltered specular light is added to the light that the G-buffer found.
    let emission = Use::add(EMISSION);
    Pass::new(stage, view, partition, KERNEL)
        .uses([hit, albedo, emission, radiance, Use::add(TALLY), Use::read(GUIDE), listed])
        .uses(radiance_cache::uses(spec, view))
        .dispatch(dispatch)
        .launches(parts.map(launch).collect())
        .taking::<PathArguments>()
        .counted_by(Work::Rays)
}

pub fn pass(spec: &FrameSpec, view: Eye) -> Pass {
    trace(spec, STAGE, view, PARTITION, spec.sparse.then_some(HOLES))
}

/// Returns the pass that path traces the pixels that reprojection and other views could not fill.
pub fn hole_fill(spec: &FrameSpec, view: Eye) -> Pass {
    let list = if spec.partner(view).is_some() { UNSHARED } else { HOLES };
    trace(spec, HOLE_FILL, view, REPROJECT, Some(list))
}
