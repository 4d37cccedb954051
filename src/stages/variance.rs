//! The variance that guides SVGF.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::Variance,
    shader: "variance",
    reads_scene: false,
    slots: &[Slot::Read(P::Guide, Of::TaskView), Slot::FilterSource, Slot::FilterTarget],
    clears: &[],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0; 3] }]
}
