//! Costs of a finished frame, extracted from its report for the cost model.

use std::collections::HashMap;
use std::ops::Range;

use super::{FrameReport, TaskTiming, TimedTask};
use crate::graph::{Seam, Stage};
use crate::schedule::{FrameCosts, StageCost, TransferCost};

/// Returns the costs of a frame in a run of `devices` devices. `begun_ms` is the time at which the devices were free to
/// start the frame, or `None` if they were still busy with another frame or an earlier attempt.
pub fn frame_costs(report: &FrameReport, devices: usize, begun_ms: Option<f64>) -> FrameCosts {
    let ms = |t: &TaskTiming| t.end_ms - t.begin_ms;
    let mut costs = FrameCosts {
        rays: report.row_tallies.iter().map(|rows| rows.iter().map(|r| r.rays).collect()).collect(),
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
        let queue = Queue::of(report, device);
        let lead_ms = queue.stages.first().zip(begun_ms).map(|(first, begun_ms)| first.begin_ms - begun_ms);
        costs.lead_ms.extend(lead_ms.map(|ms| (device, ms)));
        costs.gap_ms.extend(queue.median_gap_ms().map(|ms| (device, ms)));
        if let Seam::Halo(plan) = report.spec.seam {
            let filters = |stage| report.program.passes().iter().any(|p| p.link.is_some() && p.pass.stage == stage);
            let wait_ms = queue.exchange_wait_ms(filters, |iteration| plan.receives_before(iteration));
            costs.wait_ms.extend(wait_ms.map(|ms| (device, ms)));
        }
    }
    costs.tail_ms = if report.overlapped { 0.0 } else { tail_ms(report) };
    costs
}

/// Returns the time from the primary's last task to the end of the frame.
fn tail_ms(report: &FrameReport) -> f64 {
    let primary = report.assignment.primary();
    let last = report.tasks.iter().filter(|t| t.device == primary).map(|t| t.end_ms).reduce(f64::max);
    last.map_or(0.0, |last_ms| report.begin_ms + report.makespan_ms - last_ms)
}

/// GPU stages and uploads of one device in a frame, in order.
struct Queue<'a> {
    stages: Vec<&'a TaskTiming>,
    /// Begin times of the uploads.
    uploads_ms: Vec<f64>,
}

impl<'a> Queue<'a> {
    fn of(report: &'a FrameReport, device: usize) -> Self {
        let of_device = || report.tasks.iter().filter(move |t| t.device == device);
        Self {
            stages: of_device().filter(|t| matches!(t.kind, TimedTask::Gpu(_))).collect(),
            uploads_ms: of_device().filter(|t| t.kind == TimedTask::Upload).map(|t| t.begin_ms).collect(),
        }
    }

    /// Returns all stages but the first, each with the idle gap before it.
    fn gaps(&self) -> impl Iterator<Item = (Range<f64>, &'a TaskTiming)> {
        self.stages.windows(2).map(|pair| (pair[0].end_ms..pair[1].begin_ms, pair[1]))
    }

    /// Returns true if an upload of received rows began within `gap`, an idle gap between two stages, in milliseconds.
    fn receives_in(&self, gap: &Range<f64>) -> bool {
        self.uploads_ms.iter().any(|at_ms| gap.contains(at_ms))
    }

    /// Returns the median idle gap between successive stages, in milliseconds. Gaps in which the device received rows
    /// do not count.
    fn median_gap_ms(&self) -> Option<f64> {
        let mut gaps_ms: Vec<f64> =
            self.gaps().filter(|(gap, _)| !self.receives_in(gap)).map(|(gap, _)| gap.end - gap.start).collect();
        gaps_ms.sort_by(f64::total_cmp);
        gaps_ms.get(gaps_ms.len() / 2).copied()
    }

    /// Returns the mean time in milliseconds that the queue waited for neighbours' rows before filter passes. `filters`
    /// returns true for stages of the filter, and `receives` for the indices of the passes before which the device
    /// receives rows. The first pass does not count: before it, the queue waits for other devices to finish tracing.
    fn exchange_wait_ms(&self, filters: impl Fn(Stage) -> bool, receives: impl Fn(usize) -> bool) -> Option<f64> {
        let mut passes = HashMap::new();
        let mut waits_ms = Vec::new();
        let is_filter = |t: &TaskTiming| matches!(t.kind, TimedTask::Gpu(stage) if filters(stage));
        for (gap, stage) in self.gaps().filter(|(_, s)| is_filter(s)) {
            let pass = passes.entry(stage.view).or_insert(0);
            if *pass > 0 && receives(*pass) {
                waits_ms.push(if self.receives_in(&gap) { gap.end - gap.start } else { 0.0 });
            }
            *pass += 1;
        }
        let count = waits_ms.len() as f64;
        (count > 0.0).then(|| waits_ms.iter().sum::<f64>() / count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::rig::Eye;

    fn timing(kind: TimedTask, begin_ms: f64, end_ms: f64) -> TaskTiming {
        TaskTiming {
            stage: "".into(),
            kind,
            view: Eye::LEFT,
            device: 0,
            rows: 0..1,
            begin_ms,
            end_ms,
            bytes: None,
            predicted_ms: None,
            submissions: 1,
            transfer: None,
            number: 0,
            after: Vec::new(),
        }
    }

    /// Runs path tracing, then four filter iterations. The first and the third wait for rows, the rows of the second
    /// arrive in time, and the fourth receives none.
    #[test]
    fn gaps_are_the_hosts_and_waits_are_for_rows() {
        let atrous = |begin_ms, end_ms| timing(TimedTask::Gpu(Stage("atrous")), begin_ms, end_ms);
        let stages = [
            timing(TimedTask::Gpu(Stage("path_trace")), 0.0, 10.0),
            atrous(15.0, 16.0),
            atrous(16.25, 17.0),
            atrous(21.0, 22.0),
            atrous(22.25, 23.0),
        ];
        let queue = Queue { stages: stages.iter().collect(), uploads_ms: vec![14.0, 15.5, 20.0] };
        let filters = |stage| stage == Stage("atrous");
        assert_eq!(queue.median_gap_ms(), Some(0.25));
        assert_eq!(queue.exchange_wait_ms(filters, |iteration| iteration < 3), Some(2.0));
        assert_eq!(queue.exchange_wait_ms(filters, |iteration| iteration == 1), Some(0.0));
        assert_eq!(queue.exchange_wait_ms(filters, |_| false), None);
    }
}
