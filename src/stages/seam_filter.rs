//! Bilateral smoothing across the seams of stripes that were filtered apart.

use super::atrous::inverse_sigma2_bits;
use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};

pub(super) const ROOM: Room = Room {
    stage: Stage::SeamFilter,
    shader: "seam_filter",
    reads_scene: false,
    slots: &[Slot::Read(P::Guide, Of::TaskView), Slot::FilterSource, Slot::FilterTarget],
    clears: &[],
    dispatches,
};

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [0, inverse_sigma2_bits(1), 0] }]
}
