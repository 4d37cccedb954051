//! Antialiasing over frames, and display encoding.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::Resolve,
    shader: "resolve",
    reads_scene: false,
    slots: &[
        Slot::FilterSource,
        Slot::Read(P::LastResolved, Of::TaskView),
        Slot::Write(P::Resolved),
        Slot::Write(P::Linear),
        Slot::Write(P::Display),
        Slot::PreviousViews,
        Slot::Write(P::Tally),
    ],
    clears: &[],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0; 3] }]
}
