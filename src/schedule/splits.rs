//! Splits a device's work into submissions that are each predicted to stay within a time bound, since the GPU watchdog
//! (TDR on Windows) resets a device that is busy for seconds.

use std::cmp::Ordering;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::cost::CostModel;
use crate::graph::{Dispatch, FrameGraph, Pass, Program, SceneUse, Task, TaskKind};
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

/// Assumed time per pixel, on a device that has not run the pass yet, of passes that read no scene. A filter of 25 taps
/// takes about 1,500 operations and 40 bytes: 1.5e-5 ms at 100 billion operations a second, a quarter of the speed of
/// integrated GPUs of 2015.
const UNKNOWN_PIXEL_MS: f64 = 2e-5;

/// Assumed time per path. It holds for such a GPU as well, but is a hundred times that of fast ones. Hence a device times
/// the first rows of a pass that would exceed the bound: see [`Splits::probes`].
pub const UNKNOWN_PATH_MS: f64 = 2e-3;

/// Division of a device's work into submissions, in addition to those that its transfers end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Splits {
    pub ends: Vec<Split>,
    /// Indices of tasks of unknown time, which the device divides itself. It times the first rows, and the more it has
    /// timed, the more it submits at once.
    pub probes: Vec<usize>,
    /// Bound of the time of a submission, in milliseconds.
    pub bound_ms: f64,
}

impl Splits {
    /// Leaves it to the device to divide all its tasks that read the scene.
    pub fn probing_all(mut self, graph: &FrameGraph, device: usize) -> Self {
        let reads_scene = |task: &Task| graph.pass(task).is_some_and(|pass| pass.pass.kernel.scene == SceneUse::Read);
        let own = graph.parts_of(device).0.iter().enumerate();
        self.probes = own.filter(|(_, task)| reads_scene(task)).map(|(number, _)| number).collect();
        self.ends.retain(|split| !self.probes.contains(&split.task));
        self
    }
}

/// Returns the splits of a device's tasks into the fewest submissions of at most `bound_ms` each, in a frame of
/// these samples per pixel. Work that exceeds the bound and cannot be split becomes a submission of its own.
pub fn splits(graph: &FrameGraph, model: &CostModel, device: usize, bound_ms: f64, samples: PixelSamples) -> Splits {
    let (own, _) = graph.parts_of(device);
    let mut splits = Splits { bound_ms, ..Splits::default() };
    let mut left_ms = bound_ms;
    for (number, task) in own.iter().enumerate() {
        let TaskKind::Dispatch { pass, .. } = task.kind else {
            // Transfers end submissions.
            left_ms = bound_ms;
            continue;
        };
        let work = Divisible::new(&graph.program, pass, &task.rows, samples);
        let pass = &graph.program.passes()[pass].pass;
        let all_samples = f64::from(work.samples.iter().sum::<u32>());
        let (reads_scene, all) = (pass.kernel.scene == SceneUse::Read, Position::start(&task.rows)..Position::END);
        let is_known = model.cautious_pass_ms(pass, device, &task.rows, 0.0).is_some();
        if reads_scene && !is_known && work.paths(&all) * UNKNOWN_PATH_MS > bound_ms {
            splits.probes.push(number);
            left_ms = bound_ms;
            continue;
        }
        let ms = |run: u32, rows: Range<u32>| match model.cautious_pass_ms(pass, device, &rows, work.pixels(&rows)) {
            Some(ms) => ms * f64::from(work.samples[run as usize]) / all_samples,
            None if reads_scene => UNKNOWN_PATH_MS * work.paths_of(run, rows),
            None => UNKNOWN_PIXEL_MS * work.pixels(&rows),
        };
        let mut at = all.start;
        loop {
            let (mut to, cost_ms) = work.reach(at, left_ms, ms);
            left_ms -= cost_ms;
            if to == at && left_ms >= bound_ms {
                (to, left_ms) = (work.next(at), 0.0);
            }
            if to == Position::END {
                break;
            }
            splits.ends.push(Split { task: number, at: to });
            (at, left_ms) = (to, bound_ms);
        }
    }
    splits
}

/// A task that can be divided between its rows, and between the runs of its kernel.
pub struct Divisible<'a> {
    pub rows: &'a Range<u32>,
    pub width: u32,
    /// Number of rows that are computed together; `None` if rows cannot be divided.
    pub step: Option<u32>,
    /// Samples per pixel of each run.
    pub samples: Vec<u32>,
}

impl<'a> Divisible<'a> {
    /// Describes a pass of the program, given by its index, on these rows.
    pub fn new(program: &Program, pass: usize, rows: &'a Range<u32>, samples: PixelSamples) -> Self {
        let pass = &program.passes()[pass].pass;
        let width = pass.grid.extent(program.extent).width;
        let samples = samples.runs(&pass.launches).map(|run| run.samples).collect();
        Self { rows, width, step: step(pass), samples }
    }

    /// Returns the number of paths if each pixel starts one per sample.
    pub fn paths(&self, part: &Range<Position>) -> f64 {
        (0..self.samples.len() as u32).map(|run| self.paths_of(run, rows_in(part, self.rows, run))).sum()
    }

    /// Returns the number of paths of these rows of a run.
    pub fn paths_of(&self, run: u32, rows: Range<u32>) -> f64 {
        self.pixels(&rows) * f64::from(self.samples[run as usize])
    }

    fn pixels(&self, rows: &Range<u32>) -> f64 {
        f64::from(self.width) * f64::from(rows.end.saturating_sub(rows.start))
    }

    /// Returns the furthest position such that the work from `from` to there costs at most `most`, and what it costs.
    /// `cost` returns the cost of some rows of a run.
    pub fn reach(&self, from: Position, most: f64, cost: impl Fn(u32, Range<u32>) -> f64) -> (Position, f64) {
        let (mut at, mut sum) = (from, 0.0);
        while (at.run as usize) < self.samples.len() {
            let left = most - sum;
            let rest = cost(at.run, at.row..self.rows.end);
            if rest > left {
                let fits = |to| cost(at.run, at.row..to) <= left;
                return match self.step.and_then(|step| last_fitting(at.row..self.rows.end, step, fits)) {
                    Some(row) => (Position { row, ..at }, sum + cost(at.run, at.row..row)),
                    None => (at, sum),
                };
            }
            sum += rest;
            at = Position { run: at.run + 1, row: self.rows.start };
        }
        (Position::END, sum)
    }

    /// Returns the position after the smallest part of the work that begins at `from`.
    pub fn next(&self, from: Position) -> Position {
        let row = self.step.map_or(self.rows.end, |step| (from.row / step + 1) * step);
        match from {
            Position { run, .. } if row < self.rows.end => Position { run, row },
            Position { run, .. } if (run as usize) + 1 < self.samples.len() => {
                Position { run: run + 1, row: self.rows.start }
            }
            _ => Position::END,
        }
    }
}

/// Returns the rows that a part of a task on `rows` covers in the kernel run with the index `run`.
pub fn rows_in(part: &Range<Position>, rows: &Range<u32>, run: u32) -> Range<u32> {
    let begin = match run.cmp(&part.start.run) {
        Ordering::Less => rows.end,
        Ordering::Equal => part.start.row,
        Ordering::Greater => rows.start,
    };
    let end = match run.cmp(&part.end.run) {
        Ordering::Less => rows.end,
        Ordering::Equal => part.end.row,
        Ordering::Greater => rows.start,
    };
    begin..end
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
        let stage = |device, task: &Task| {
            let pass = &graph.pass(task)?.pass;
            let (rows, busy_ms) = (task.rows.clone(), task.rows.len() as f64);
            Some(StageCost { stage: pass.stage, view: pass.view, device, rows, busy_ms })
        };
        let stages = (0..devices).flat_map(|d| graph.tasks_of(d).iter().filter_map(move |task| stage(d, task)));
        let rays = [0, 1].map(|_| vec![20 * EXTENT.width; EXTENT.height as usize]);
        model.learn(&FrameCosts { stages: stages.collect(), rays: rays.to_vec(), ..Default::default() });
        model
    }

    /// Returns the number of rows of each submission. Rows of one run count in proportion to the run's fraction of the
    /// pass's samples.
    fn submissions(graph: &FrameGraph, device: usize, splits: &[Split], spp: u32) -> Vec<f64> {
        let mut all = vec![0.0];
        for (number, task) in graph.parts_of(device).0.iter().enumerate() {
            let Some(linked) = graph.pass(task) else {
                all.push(0.0);
                continue;
            };
            let runs = PixelSamples::own(0..spp, true).runs(&linked.pass.launches);
            let samples: Vec<f64> = runs.map(|run| run.samples.into()).collect();
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
        assert_eq!(splits(&graph, &model, 0, 1e5, PixelSamples::own(0..1, true)).ends, []);
        assert_eq!(splits(&graph, &model, 1, 1e5, PixelSamples::own(0..1, true)).ends, []);
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
                    let all = submissions(&graph, device, &splits.ends, spp);
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
    fn tasks_of_unknown_cost_are_probed_beyond_the_bound() {
        let (graph, model) = frame(1);
        let pixels = f64::from(EXTENT.width * EXTENT.height);
        let found = |bound_ms| splits(&graph, &model, 0, bound_ms, PixelSamples::own(0..4, true));
        let kernel_of = |task: usize| graph.pass(&graph.tasks_of(0)[task]).map_or("", |linked| linked.pass.kernel.name);
        // Only path tracing, and antialiasing of the right eye's surfaces, take more than one sample per pixel.
        let Splits { ends, probes, .. } = found(2.0 * pixels * UNKNOWN_PATH_MS);
        assert_eq!(
            probes.iter().map(|task| kernel_of(*task)).collect::<Vec<_>>(),
            ["path_trace", "gbuffer", "path_trace"]
        );
        assert_eq!(ends, []);
        // Filters are split by their pixels.
        let Splits { ends, probes, .. } = found(0.5 * pixels * UNKNOWN_PIXEL_MS);
        assert!(ends.iter().any(|split| kernel_of(split.task) == "svgf"));
        assert!(ends.iter().all(|split| !probes.contains(&split.task)));
        assert_eq!(found(1e6), Splits { bound_ms: 1e6, ..Splits::default() });
    }

    #[test]
    fn too_long_tasks_are_split_into_smallest_parts() {
        let (graph, model) = frame(1);
        let model = learned(&graph, model, 1);
        let splits = splits(&graph, &model, 0, 1e-6, PixelSamples::own(0..1, true)).ends;
        for (number, task) in graph.parts_of(0).0.iter().enumerate() {
            let parts = parts(&splits, number, &task.rows);
            let rows: Vec<u32> = parts.iter().map(|p| p.start.row).collect();
            let step = step(&graph.pass(task).unwrap().pass).unwrap();
            let expected: Vec<u32> = (0..EXTENT.height).step_by(step as usize).collect();
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
