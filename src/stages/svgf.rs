//! One iteration of SVGF.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage, svgf_step};

pub(super) const ROOM: Room = Room {
    stage: Stage::Svgf,
    shader: "svgf",
    reads_scene: false,
    slots: &[Slot::Read(P::Guide, Of::TaskView), Slot::FilterSource, Slot::FilterTarget],
    clears: &[],
    dispatches,
};

/// Standard deviations by which the luminance of two pixels may differ.
const SIGMA: f32 = 4.0;

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    let args = [svgf_step(work.index), (SIGMA * SIGMA).to_bits(), work.index];
    vec![Dispatch::Rows { columns: work.settings.extent.width, args }]
}
