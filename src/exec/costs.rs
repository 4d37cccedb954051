//! What a finished frame tells the cost model.

use super::{FrameReport, TaskTiming, TimedTask};
use crate::schedule::{FrameCosts, StageCost, TransferCost};

/// Costs of a frame on this many devices.
pub fn frame_costs(report: &FrameReport, devices: usize) -> FrameCosts {
    let ms = |t: &TaskTiming| t.end_ms - t.begin_ms;
    let mut costs = FrameCosts {
        rays: report.row_tallies.each_ref().map(|rows| rows.iter().map(|r| r.rays).collect()),
        ..Default::default()
    };
    for task in &report.tasks {
        match task.kind {
            TimedTask::Gpu(stage) => costs.stages.push(StageCost {
                stage,
                view: task.view,
                device: task.device,
                rows: task.rows.clone(),
                busy_ms: ms(task),
            }),
            TimedTask::Download | TimedTask::Upload => costs.transfers.push(TransferCost {
                device: task.device,
                is_upload: task.kind == TimedTask::Upload,
                bytes: task.bytes.unwrap_or(0),
                ms: ms(task),
            }),
        }
    }
    for device in 0..devices {
        let is_stage = |t: &&TaskTiming| t.device == device && matches!(t.kind, TimedTask::Gpu(_));
        let mut stages: Vec<&TaskTiming> = report.tasks.iter().filter(is_stage).collect();
        stages.sort_by(|a, b| a.begin_ms.total_cmp(&b.begin_ms));
        if let Some(first) = stages.first().filter(|_| !report.overlapped) {
            costs.lead_ms.push((device, first.begin_ms - report.begin_ms));
        }
        let mut gaps_ms: Vec<f64> = stages.windows(2).map(|pair| pair[1].begin_ms - pair[0].end_ms).collect();
        gaps_ms.sort_by(f64::total_cmp);
        // Few stages wait for transfers, so the middle one does not.
        if let Some(&middle_ms) = gaps_ms.get(gaps_ms.len() / 2) {
            costs.gap_ms.push((device, middle_ms));
        }
    }
    let primary = report.assignment.primary();
    let last = report.tasks.iter().filter(|t| t.device == primary).map(|t| t.end_ms).reduce(f64::max);
    let end_ms = report.begin_ms + report.makespan_ms;
    costs.tail_ms = last.map_or(0.0, |last_ms| end_ms - last_ms);
    costs
}
