//! Primary visibility of one view.

use super::path_trace::batches;
use super::{Dispatch, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};
use crate::scene::rig::Eye;

pub(super) const ROOM: Room =
    Room { stage: Stage::Gbuffer, shader: "gbuffer", reads_scene: true, slots: &SLOTS, clears: &[], dispatches };

/// Primary rays of one dispatch, a pixel.
const RAYS_PER_DISPATCH: u32 = 64;

/// In the shader.
const UNSAMPLED_ONLY: u32 = 1;

/// Group 1 of `pixel.inc.wgsl`.
const SLOTS: [Slot; 6] = [
    Slot::Write(P::Hit),
    Slot::Write(P::Albedo),
    Slot::Write(P::Emission),
    Slot::Write(P::Radiance),
    Slot::Write(P::Tally),
    Slot::Write(P::Guide),
];

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    let columns = work.settings.extent.width;
    let centre = Dispatch::Rows { columns, args: [0; 3] };
    // Path tracing brings means over the pixels that it samples; all others, and what is reprojected into, need them from
    // here.
    let reprojected = work.settings.reproject && work.view == Eye::Right;
    let needs_means = work.settings.jitter(work.spp) && (reprojected || work.settings.leaves_pixels());
    let only = if reprojected { 0 } else { UNSAMPLED_ONLY };
    let means = batches(if needs_means { work.spp } else { 0 }, RAYS_PER_DISPATCH);
    let means = means.map(|[begin, end, _]| Dispatch::Rows { columns, args: [begin, end, only] });
    std::iter::once(centre).chain(means).collect()
}
