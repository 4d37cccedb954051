//! Path tracing of the holes that reprojection listed.

use super::Room;
use super::path_trace;
use crate::graph::Stage;

/// Shares its pipeline with path tracing.
pub(super) const ROOM: Room = Room { stage: Stage::HoleFill, dispatches: path_trace::listed, ..path_trace::ROOM };
