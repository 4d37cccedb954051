//! What a finished frame tells the cost model.

use super::{FrameReport, TaskTiming, TimedTask};
use crate::graph::Stage;
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
    costs.wait_ms = (0..devices).filter_map(|d| Some((d, exchange_wait_ms(report, d)?))).collect();
    let primary = report.assignment.primary();
    let last = report.tasks.iter().filter(|t| t.device == primary).map(|t| t.end_ms).reduce(f64::max);
    let end_ms = report.begin_ms + report.makespan_ms;
    costs.tail_ms = last.map_or(0.0, |last_ms| end_ms - last_ms);
    costs
}

/// Mean time for which a device's queue stood still before an iteration of the filter because of rows that it received;
/// not before the first one, where it waits for tracing to end elsewhere.
fn exchange_wait_ms(report: &FrameReport, device: usize) -> Option<f64> {
    let of_device = || report.tasks.iter().filter(|t| t.device == device);
    let mut stages: Vec<&TaskTiming> = of_device().filter(|t| matches!(t.kind, TimedTask::Gpu(_))).collect();
    stages.sort_by(|a, b| a.begin_ms.total_cmp(&b.begin_ms));
    let mut begun = [false; 2];
    let mut waits_ms = Vec::new();
    for pair in stages.windows(2).filter(|p| matches!(p[1].kind, TimedTask::Gpu(s) if s.ratio_group() == Stage::Atrous)) {
        let gap = pair[0].end_ms..pair[1].begin_ms;
        let is_first = !std::mem::replace(&mut begun[pair[1].view as usize], true);
        let received = of_device().any(|t| t.kind == TimedTask::Upload && gap.contains(&t.begin_ms));
        if received && !is_first {
            waits_ms.push(gap.end - gap.start);
        }
    }
    let count = waits_ms.len() as f64;
    (count > 0.0).then(|| waits_ms.iter().sum::<f64>() / count)
}
