//! Splits a device's work into submissions that are each predicted to stay within a time bound, since the GPU watchdog
//! (TDR on Windows) resets a device that is busy for seconds.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::cost::CostModel;
use crate::graph::{Dispatch, FrameGraph, Pass, SceneUse, TaskKind};
use crate::samples::PixelSamples;

/// Position in a task, which runs its kernel one or more times: right before row `row` of the run with the index `run`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Position {
    pub run: u32,
    pub row: u32,
}

impl Position {
    /// Position after all runs.
    pub const END: Self = Self { run: u32::MAX, row: 0 };

    pub fn start(rows: &Range<u32>) -> Self {
        Self { run: 0, row: rows.start }
    }
}

/// End of a submission: position `at` in the task with the index `task` among the device's tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Split {
    pub task: usize,
    pub at: Position,
}

/// Divides the task with the index `task`, which computes `rows`, at its splits. The first part is empty if a split is at
/// the task's start.
pub fn parts(splits: &[Split], task: usize, rows: &Range<u32>) -> Vec<Range<Position>> {
    let inner = splits.iter().filter(|split| split.task == task).map(|split| split.at);
    let mut ends: Vec<Position> = std::iter::once(Position::start(rows)).chain(inner).collect();
    ends.push(Position::END);
    ends.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

/// Assumed times on a device that has not run the pass yet: per path, and per pixel in passes that trace no paths. They
/// hold even for a GPU that is ten times slower than a slow one of 2015.
const UNKNOWN_PATH_MS: f64 = 2e-3;
const UNKNOWN_PIXEL_MS: f64 = 1e-4;

/// Returns the splits of a device's tasks into the fewest submissions of at most `bound_ms` each, in a frame of
/// these samples per pixel. Work that exceeds the bound and cannot be split becomes a submission of its own.
pub fn splits(
    graph: &FrameGraph,
    model: &CostModel,
    device: usize,
    bound_ms: f64,
    samples: PixelSamples,
) -> Vec<Split> {
    let (own, _) = graph.parts_of(device);
    let mut splits = Vec::new();
    let mut left_ms = bound_ms;
    for (number, task) in own.iter().enumerate() {
        let TaskKind::Dispatch { pass, .. } = task.kind else {
            // Transfers end submissions.
            left_ms = bound_ms;
            continue;
        };
        let pass = &graph.program.passes()[pass].pass;
        let width = pass.grid.extent(graph.program.extent).width;
        let samples: Vec<u32> = samples.runs(&pass.launches).map(|run| run.samples).collect();
        let all_samples = f64::from(samples.iter().sum::<u32>());
        for (run, samples) in (0..).zip(samples) {
            let ms = |rows: Range<u32>| {
                let pixels = f64::from(width) * f64::from(rows.end - rows.start);
                match model.cautious_pass_ms(pass, device, &rows, pixels) {
                    Some(ms) => ms * f64::from(samples) / all_samples,
                    None if pass.kernel.scene == SceneUse::Read => UNKNOWN_PATH_MS * pixels * f64::from(samples),
                    None => UNKNOWN_PIXEL_MS * pixels,
                }
            };
            let (mut row, end) = (task.rows.start, task.rows.end);
            loop {
                let rest_ms = ms(row..end);
                if rest_ms <= left_ms {
                    left_ms -= rest_ms;
                    break;
                }
                let fitting = step(pass).and_then(|step| last_fitting(row..end, step, |to| ms(row..to) <= left_ms));
                let least = || step(pass).map_or(end, |step| (row / step + 1) * step).min(end);
                row = fitting.unwrap_or_else(|| if left_ms < bound_ms { row } else { least() });
                if row == end {
                    left_ms = 0.0;
                    break;
                }
                splits.push(Split { task: number, at: Position { run, row } });
                left_ms = bound_ms;
            }
        }
    }
    splits
}

/// Returns the number of rows that a pass computes together; `None` if it cannot be split by rows.
fn step(pass: &Pass) -> Option<u32> {
    let rows = match pass.dispatch {
        Dispatch::Invocations([_, height]) => height.max(1) * pass.kernel.workgroup[1],
        Dispatch::Workgroups([_, height]) | Dispatch::Displaced([_, height]) => height,
        Dispatch::List(_) => pass.kernel.workgroup[1],
        Dispatch::Once(_) => return None,
    };
    Some(rows.max(1))
}

/// Returns the largest row that is a multiple of `step` and up to which the work fits; `None` if that is not beyond the
/// first row.
fn last_fitting(rows: Range<u32>, step: u32, fits: impl Fn(u32) -> bool) -> Option<u32> {
    let (mut low, mut high) = (rows.start / step, (rows.end - 1) / step + 1);
    // The work fits up to `low`, and does not fit up to `high`.
    while high - low > 1 {
        let middle = low.midpoint(high);
        if fits(middle * step) { low = middle } else { high = middle }
    }
    (low * step > rows.start).then_some(low * step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Assignment, HaloPlan, Seam, Stripes};
    use crate::image::Extent;
    use crate::passes::FrameSpec;
    use crate::passes::graph_tests::graph;
    use crate::schedule::{FrameCosts, StageCost};

    const EXTENT: Extent = Extent::new(64, 360);

    fn frame(devices: usize) -> (FrameGraph, CostModel) {
        let seam = Seam::Halo(HaloPlan::RECOMPUTE);
        let spec = FrameSpec { iterations: 3, seam, ..FrameSpec::new(EXTENT, devices) };
        let assignment = Assignment::uniform(Stripes::even(EXTENT.height, devices));
        let graph = graph(&spec, &assignment, None);
        let model = CostModel::new(&graph.program, devices);
        (graph, model)
    }

    /// Teaches the model that every pass takes 1 ms per row, over all its runs.
    fn learned(graph: &FrameGraph, mut model: CostModel, devices: usize) -> CostModel {
        let stage = |device, task: &crate::graph::Task| match task.kind {
            TaskKind::Dispatch { pass, .. } => {
                let pass = &graph.program.passes()[pass].pass;
                let (rows, busy_ms) = (task.rows.clone(), task.rows.len() as f64);
                Some(StageCost { stage: pass.stage, view: pass.view, device, rows, busy_ms })
            }
            _ => None,
        };
        let stages = (0..devices).flat_map(|d| graph.tasks_of(d).iter().filter_map(move |task| stage(d, task)));
        let rays = [0, 1].map(|_| vec![20 * EXTENT.width; EXTENT.height as usize]);
        model.learn(&FrameCosts { stages: stages.collect(), rays, ..Default::default() });
        model
    }

    /// Returns the number of rows of each submission. Rows of one run count in proportion to the run's fraction of the
    /// pass's samples.
    fn submissions(graph: &FrameGraph, device: usize, splits: &[Split], spp: u32) -> Vec<f64> {
        let mut all = vec![0.0];
        for (number, task) in graph.parts_of(device).0.iter().enumerate() {
            let TaskKind::Dispatch { pass, .. } = task.kind else {
                all.push(0.0);
                continue;
            };
            let launches = &graph.program.passes()[pass].pass.launches;
            let samples: Vec<f64> =
                PixelSamples::own(0..spp, true).runs(launches).map(|run| run.samples.into()).collect();
            let rows_to = |at: Position| {
                let begun = &samples[..samples.len().min(at.run as usize)];
                let here = samples.get(at.run as usize).map_or(0.0, |s| s * f64::from(at.row - task.rows.start));
                let height = f64::from(task.rows.end - task.rows.start);
                (begun.iter().sum::<f64>() * height + here) / samples.iter().sum::<f64>()
            };
            for (i, part) in parts(splits, number, &task.rows).into_iter().enumerate() {
                if i > 0 {
                    all.push(0.0);
                }
                *all.last_mut().unwrap() += rows_to(part.end) - rows_to(part.start);
            }
        }
        all.retain(|rows| *rows > 0.0);
        all
    }

    #[test]
    fn frame_within_the_bound_is_not_split() {
        let (graph, model) = frame(2);
        let model = learned(&graph, model, 2);
        assert_eq!(splits(&graph, &model, 0, 1e5, PixelSamples::own(0..1, true)), []);
        assert_eq!(splits(&graph, &model, 1, 1e5, PixelSamples::own(0..1, true)), []);
    }

    #[test]
    fn submissions_are_bounded_and_as_few_as_possible() {
        for (devices, spp) in [(1, 1), (1, 12), (3, 1), (3, 12)] {
            let (graph, model) = frame(devices);
            let model = learned(&graph, model, devices);
            for device in 0..devices {
                let whole: f64 = submissions(&graph, device, &[], spp).iter().sum();
                let unsplit = submissions(&graph, device, &[], spp).len() as f64;
                for bound_ms in [9.0, 40.0, 101.0, 500.0] {
                    let splits = splits(&graph, &model, device, bound_ms, PixelSamples::own(0..spp, true));
                    let all = submissions(&graph, device, &splits, spp);
                    let what = format!("{devices} devices, {spp} samples, {bound_ms} ms: {all:?}");
                    assert!((all.iter().sum::<f64>() - whole).abs() < 1e-6, "{what}");
                    assert!(all.iter().all(|ms| *ms <= bound_ms + 1e-6), "{what}");
                    // Submissions are full, up to the 8 rows that are computed together.
                    assert!(all.len() as f64 <= unsplit + whole / (bound_ms - 8.0), "{what}");
                }
            }
        }
    }

    #[test]
    fn work_of_unknown_cost_is_split_by_its_paths() {
        let (graph, model) = frame(1);
        let splits_of = |bound_ms| splits(&graph, &model, 0, bound_ms, PixelSamples::own(0..4, true));
        let paths = 4.0 * f64::from(EXTENT.width * EXTENT.height);
        let of_paths = |splits: &[Split]| {
            let is_traced = |split: &&Split| match graph.parts_of(0).0[split.task].kind {
                TaskKind::Dispatch { pass, .. } => graph.program.passes()[pass].pass.kernel.name == "path_trace",
                _ => false,
            };
            splits.iter().filter(is_traced).count() as f64
        };
        // Paths of the left eye, and of all pixels of the right eye, which may all be holes.
        let expected = 2.0 * paths * UNKNOWN_PATH_MS / 20.0;
        let found = of_paths(&splits_of(20.0));
        assert!(found >= expected - 2.0 && found <= 1.2 * expected + 2.0, "{found} instead of {expected}");
        assert_eq!(splits_of(1e6), []);
    }

    #[test]
    fn too_long_tasks_are_split_into_smallest_parts() {
        let (graph, model) = frame(1);
        let model = learned(&graph, model, 1);
        let splits = splits(&graph, &model, 0, 1e-6, PixelSamples::own(0..1, true));
        for (number, task) in graph.parts_of(0).0.iter().enumerate() {
            let parts = parts(&splits, number, &task.rows);
            let rows: Vec<u32> = parts.iter().map(|p| p.start.row).collect();
            let expected: Vec<u32> = (0..EXTENT.height).step_by(8).collect();
            // A submission ends before every task but the first.
            assert_eq!(rows[usize::from(number > 0)..], expected, "task {number}");
        }
    }

    #[test]
    fn parts_begin_and_end_where_their_task_does() {
        let at = |run, row| Position { run, row };
        assert_eq!(parts(&[], 3, &(5..9)), [at(0, 5)..Position::END]);
        let splits = [(3, at(0, 5)), (3, at(0, 8)), (4, at(0, 6)), (3, at(2, 6))].map(|(task, at)| Split { task, at });
        let expected = [at(0, 5)..at(0, 5), at(0, 5)..at(0, 8), at(0, 8)..at(2, 6), at(2, 6)..Position::END];
        assert_eq!(parts(&splits, 3, &(5..9)), expected);
    }
}
