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

/// Tolerance to differences in compressed radiance once the noise is averaged down.
const SIGMA: f32 = 1.0;
/// Iterations before radiance is compared at all: at one sample per pixel a pixel's own value says nothing about what
/// it should be, and comparing with it would keep outliers as they are.
const BLIND_ITERATIONS: u32 = 3;

/// 1 / σ² of iteration `index`, as bits.
pub(super) fn inverse_sigma2_bits(index: u32) -> u32 {
    if index < BLIND_ITERATIONS { 0 } else { (1.0 / (SIGMA * SIGMA)).to_bits() }
}

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    let step = atrous_step(work.index, work.iterations);
    // Pixels of a layer count the iterations that they take part in.
    let args = if work.settings.leaves_pixels() {
        [step, inverse_sigma2_bits(u32::MAX), BLIND_ITERATIONS]
    } else {
        [step, inverse_sigma2_bits(work.index), 0]
    };
    vec![Dispatch::Rows { columns: work.settings.extent.width, args }]
}
