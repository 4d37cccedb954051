//! Remodulation, for `resolve`.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::Compose,
    shader: "compose",
    reads_scene: false,
    slots: &[
        Slot::FilterSource,
        Slot::Read(P::Albedo, Of::TaskView),
        Slot::Read(P::Emission, Of::TaskView),
        Slot::FilterTarget,
    ],
    clears: &[],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0; 3] }]
}
