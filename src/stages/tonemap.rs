//! Remodulation and display encoding.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::Tonemap,
    shader: "tonemap",
    reads_scene: false,
    slots: &[
        Slot::FilterSource,
        Slot::Read(P::Albedo, Of::TaskView),
        Slot::Read(P::Emission, Of::TaskView),
        Slot::Write(P::Linear),
        Slot::Write(P::Display),
        Slot::Write(P::Tally),
    ],
    clears: &[],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0; 3] }]
}
