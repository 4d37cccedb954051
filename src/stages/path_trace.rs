//! Path tracing of one view, in batches of samples.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::PathTrace,
    shader: "path_trace",
    reads_scene: true,
    slots: &[
        Slot::Write(P::Hit),
        Slot::Write(P::Albedo),
        Slot::Write(P::Emission),
        Slot::Write(P::Radiance),
        Slot::Write(P::Tally),
        Slot::Write(P::Guide),
        Slot::Read(P::Holes, Of::TaskView),
    ],
    clears: &[],
    dispatches,
};

/// Paths of one dispatch, a pixel. Mesa's software driver ends all loops of an invocation once they have made 65,535
/// rounds together, and a path of 13 rays makes some thousands. It is also short enough for drivers that watch over long
/// dispatches.
pub(super) const PATHS_PER_DISPATCH: u32 = 4;

/// First and last + 1 sample of each batch.
pub(super) fn batches(spp: u32, size: u32) -> impl Iterator<Item = [u32; 3]> {
    (0..spp.div_ceil(size)).map(move |i| [i * size, (i * size + size).min(spp), 0])
}

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    if work.settings.leaves_pixels() {
        return listed(work);
    }
    let columns = work.settings.extent.width;
    batches(work.spp, PATHS_PER_DISPATCH).map(|args| Dispatch::Rows { columns, args }).collect()
}

/// `HOLES_ONLY` in the shader.
const HOLES_ONLY: u32 = 1;

/// Of the pixels that an earlier stage listed.
pub(super) fn listed(work: &Work<'_>) -> Vec<Dispatch> {
    batches(work.spp, PATHS_PER_DISPATCH)
        .map(|[first, end, _]| Dispatch::Holes { args: [first, end, HOLES_ONLY] })
        .collect()
}
