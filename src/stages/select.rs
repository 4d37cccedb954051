//! The list of pixels that path tracing takes where others are left to the filter.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::Select,
    shader: "select",
    reads_scene: false,
    slots: &[
        Slot::Read(P::Hit, Of::TaskView),
        Slot::Read(P::Guide, Of::TaskView),
        Slot::Write(P::Radiance),
        Slot::Write(P::Tally),
        Slot::Write(P::Holes),
    ],
    // The count of pixels and of workgroups.
    clears: &[(P::Holes, Some(8))],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0; 3] }]
}
