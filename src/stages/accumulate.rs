//! Light of the frames before, joined with this one's.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::Accumulate,
    shader: "accumulate",
    reads_scene: false,
    slots: &[
        Slot::Read(P::Hit, Of::TaskView),
        Slot::Read(P::Guide, Of::TaskView),
        Slot::Read(P::Radiance, Of::TaskView),
        Slot::Read(P::LastGuide, Of::TaskView),
        Slot::Read(P::LastMoments, Of::TaskView),
        Slot::Read(P::LastHistory, Of::TaskView),
        Slot::Read(P::LastGuide, Of::Left),
        Slot::Read(P::LastMoments, Of::Left),
        Slot::Read(P::LastHistory, Of::Left),
        Slot::FilterTarget,
        Slot::Write(P::Moments),
        Slot::PreviousViews,
        Slot::Write(P::Tally),
    ],
    clears: &[],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0; 3] }]
}
