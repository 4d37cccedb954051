//! Path tracing of the holes that reprojection listed.

use super::path_trace::{self, PATHS_PER_DISPATCH, batches};
use super::{Dispatch, Room, Work};
use crate::graph::Stage;

/// Shares its pipeline with path tracing.
pub(super) const ROOM: Room = Room { stage: Stage::HoleFill, dispatches, ..path_trace::ROOM };

/// `HOLES_ONLY` in the shader.
const HOLES_ONLY: u32 = 1;

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    batches(work.spp, PATHS_PER_DISPATCH)
        .map(|[first, end, _]| Dispatch::Holes { args: [first, end, HOLES_ONLY] })
        .collect()
}
