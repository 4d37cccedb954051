//! Path tracing of the holes that reprojection listed.

use super::path_trace::{PATHS_PER_DISPATCH, batches};
use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::HoleFill,
    shader: "hole_fill",
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

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    batches(work.spp, PATHS_PER_DISPATCH).map(|args| Dispatch::Holes { args }).collect()
}
