//! Measured costs of a frame, from which the model learns.

use std::ops::Range;

use crate::graph::Stage;
use crate::scene::rig::Eye;
use crate::schedule::relative_cost::RelativeCost;

/// Measured time of one task of a stage on one device in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct StageCost {
    pub stage: Stage,
    pub view: Eye,
    pub device: usize,
    /// The rows that were computed, margins included.
    pub rows: Range<u32>,
    pub busy_ms: f64,
}

/// Measured host time of the download or the upload of a transfer, on the thread of its device.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferCost {
    pub device: usize,
    pub is_upload: bool,
    pub bytes: u64,
    pub ms: f64,
}

/// Measured costs of a frame. Pairs are (device, milliseconds).
#[derive(Clone, Debug, Default)]
pub struct FrameCosts {
    pub stages: Vec<StageCost>,
    pub transfers: Vec<TransferCost>,
    /// Counted rays, by eye and row of the frame.
    pub rays: Vec<Vec<u32>>,
    /// Time from the start of the frame to the first stage, for each device that ran a stage. Empty if devices were
    /// still busy with another frame or an earlier attempt.
    pub lead_ms: Vec<(usize, f64)>,
    /// Median gap between consecutive stages, for each device that ran several stages. Gaps in which a device received
    /// rows do not count.
    pub gap_ms: Vec<(usize, f64)>,
    /// Mean time that a device waited for rows, for each device that received rows between the filter's iterations.
    pub wait_ms: Vec<(usize, f64)>,
    /// Time from the primary's last task to the end of the frame; 0 if unknown.
    pub tail_ms: f64,
    /// Relative cost of the stages at the quality of the frame.
    pub relative_cost: RelativeCost,
}
