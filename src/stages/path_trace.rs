//! Path tracing of one view, in batches of samples.

use super::gbuffer::SAMPLE_SLOTS;
use super::{Dispatch, Room, Work};
use crate::graph::Stage;

pub(super) const ROOM: Room = Room {
    stage: Stage::PathTrace,
    shader: "path_trace",
    reads_scene: true,
    slots: &SAMPLE_SLOTS,
    clears: &[],
    dispatches,
};

/// Samples of one dispatch: short enough for drivers that watch over long ones.
const BATCH: u32 = 32;

/// First and last + 1 sample of each batch.
pub(super) fn batches(spp: u32) -> impl Iterator<Item = [u32; 3]> {
    (0..spp.div_ceil(BATCH)).map(move |i| [i * BATCH, (i * BATCH + BATCH).min(spp), 0])
}

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    let columns = work.settings.extent.width;
    batches(work.spp).map(|args| Dispatch::Rows { columns, args }).collect()
}
