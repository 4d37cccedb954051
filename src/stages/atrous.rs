//! One iteration of the à-trous filter.

use super::{Dispatch, Of, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage, atrous_step};

pub(super) const ROOM: Room = Room {
    stage: Stage::Atrous,
    shader: "atrous",
    reads_scene: false,
    slots: &[Slot::Read(P::Guide, Of::TaskView), Slot::FilterSource, Slot::FilterTarget],
    clears: &[],
    dispatches,
};

/// Tolerance of the first iteration to differences in (compressed) radiance; it halves with the step, as in Dammertz.
const SIGMA: f32 = 0.8;

/// 1 / σ² of iteration `index`, as bits.
pub(super) fn inverse_sigma2_bits(index: u32) -> u32 {
    let sigma = SIGMA / (1u32 << index.min(20)) as f32;
    (1.0 / (sigma * sigma)).to_bits()
}

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    let step = atrous_step(work.index, work.settings.iterations);
    let args = [step, inverse_sigma2_bits(work.index), 0];
    vec![Dispatch::Rows { columns: work.settings.extent.width, args }]
}
