//! Reproduces Leria, Mäkitalo & Jääskeläinen 2024, "Real-time Stereoscopic Image-parallel Path Tracing". Compares
//! distributing every stage over the devices with a baseline that distributes only path tracing, and prints the paper's
//! numbers beside ours.

use std::array;

use serde::{Serialize, Serializer};

use super::csv::{Column, Csv, number, optional};
use super::study::{cell, quartiles, table};
use super::{ReportError, Table, median_of};
use crate::exec::{FrameReport, TimedTask};
use crate::graph::{FrameGraph, TaskKind};
use crate::report::{Axis, Chart, Series, line_chart_svg};
use crate::schedule::{CostModel, Prediction, task_ms};

/// Number of frames in the paper's run along a path.
pub const FRAMES: u32 = 104;

/// Arrangements, the baseline first: stages after path tracing run on the primary only, or every stage runs on all
/// devices.
pub const ARRANGEMENTS: [&str; 2] = ["baseline", "proposed"];

/// A row of the paper's table "Performance per stage" (San Miguel), with the corresponding stages here.
struct Part {
    name: &'static str,
    column: &'static str,
    /// Stages of this part; empty for the part that takes all other stages.
    stages: &'static [&'static str],
    /// Times per frame that the paper reports, for each of [`ARRANGEMENTS`].
    cited_ms: [f64; 2],
}

const fn part(
    name: &'static str,
    column: &'static str,
    stages: &'static [&'static str],
    baseline_ms: f64,
    proposed_ms: f64,
) -> Part {
    Part { name, column, stages, cited_ms: [baseline_ms, proposed_ms] }
}

const SENT: &str = "download";
const RECEIVED: &str = "upload";

const PARTS: [Part; 8] = [
    part("skinning", "skinning_ms", &["skin", "refit"], 0.003, 0.08),
    part("path tracing", "path_tracing_ms", &["path_trace"], 3.45, 3.07),
    part("G-buffer", "gbuffer_ms", &["gbuffer", "motion"], 2.19, 2.61),
    part("reprojection", "reprojection_ms", &["reproject"], 0.11, 0.04),
    part("hole filling", "hole_filling_ms", &["hole_fill"], 3.38, 1.17),
    part("denoising", "denoising_ms", &[], 3.65, 0.87),
    part("sending", "sending_ms", &[SENT], 1.05, 0.26),
    part("receiving", "receiving_ms", &[RECEIVED], 0.60, 0.29),
];

fn part_of(stage: &str) -> usize {
    let rest = PARTS.iter().position(|part| part.stages.is_empty());
    PARTS.iter().position(|part| part.stages.contains(&stage)).or(rest).unwrap_or_default()
}

/// The paper's busy fractions on San Miguel, for each of [`ARRANGEMENTS`]: of the primary, and the mean of the other
/// devices.
const CITED_BUSY: [[f64; 2]; 2] = [[0.99, 0.53], [0.94, 0.97]];

/// The paper's scenes, each with the total time in seconds of about [`FRAMES`] frames for each of [`ARRANGEMENTS`].
const CITED_S: [(&str, [f64; 2]); 3] =
    [("San Miguel", [1.59, 0.87]), ("Sponza", [1.93, 0.69]), ("Bistro Exterior", [3.26, 1.54])];

/// Times of a frame, ms.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTimes {
    makespan_ms: f64,
    /// Time that each device spent in stages, without transfers.
    busy_ms: Vec<f64>,
    /// Time of each of [`PARTS`], averaged over the devices that ran any of it.
    part_ms: [Option<f64>; PARTS.len()],
}

impl FrameTimes {
    pub fn measured(frame: &FrameReport) -> Self {
        let times = frame.tasks.iter().map(|task| {
            let stage = match task.kind {
                TimedTask::Gpu(stage) => stage.name(),
                TimedTask::Download => SENT,
                TimedTask::Upload => RECEIVED,
            };
            (task.device, stage, task.end_ms - task.begin_ms)
        });
        Self::new(frame.makespan_ms, frame.assignment.devices(), times)
    }

    /// Returns the times of a simulated frame: the makespan of the `prediction`, and the times that the `model`
    /// predicts for the tasks of the `graph`.
    pub fn simulated(graph: &FrameGraph, model: &CostModel, prediction: &Prediction) -> Self {
        let times = (0..graph.devices()).flat_map(|device| graph.tasks_of(device)).filter_map(|task| {
            let stage = match task.kind {
                TaskKind::Dispatch { pass, .. } => graph.program.passes()[pass].pass.stage.name(),
                TaskKind::Download { .. } => SENT,
                TaskKind::Upload { .. } => RECEIVED,
                TaskKind::Stitch => return None,
            };
            Some((task.device, stage, task_ms(graph, model, model.relative_cost(), task)))
        });
        Self::new(prediction.makespan_ms, graph.devices(), times)
    }

    /// Sums up the `times` of tasks, each with its device and stage.
    fn new<'a>(makespan_ms: f64, devices: usize, times: impl Iterator<Item = (usize, &'a str, f64)>) -> Self {
        let mut ms = vec![[0.0; PARTS.len()]; devices];
        let mut busy_ms = vec![0.0; devices];
        for (device, stage, time_ms) in times {
            ms[device][part_of(stage)] += time_ms;
            if ![SENT, RECEIVED].contains(&stage) {
                busy_ms[device] += time_ms;
            }
        }
        let part_ms = array::from_fn(|part| mean(ms.iter().map(|of| of[part]).filter(|ms| *ms > 0.0)));
        Self { makespan_ms, busy_ms, part_ms }
    }

    /// Returns the busy fraction of the primary, and the mean of the other devices.
    fn busy_shares(&self) -> [Option<f64>; 2] {
        let share = |ms: &f64| ms / self.makespan_ms;
        [self.busy_ms.first().map(share), mean(self.busy_ms.iter().skip(1).map(share))]
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// A run of both arrangements on the same devices.
pub struct Run {
    /// `measured` or `simulated`.
    pub source: &'static str,
    pub shot: String,
    pub devices: usize,
    /// Frames of each of [`ARRANGEMENTS`], the same number for both.
    pub frames: [Vec<FrameTimes>; 2],
}

/// Results of an arrangement. Values over frames are medians.
#[derive(Clone, Debug, Serialize)]
pub struct LeriaRow {
    /// `measured`, `simulated` or `cited`.
    pub source: &'static str,
    pub scene: String,
    pub devices: Option<usize>,
    pub arrangement: &'static str,
    pub frames: u32,
    /// Total time of all frames.
    pub total_s: Option<f64>,
    /// Quartiles of the makespans.
    pub makespan_ms: Option<[f64; 3]>,
    /// Median over frames of the speedup over the same frame of the baseline. Cited values are speedups of the total
    /// time.
    pub speedup: f64,
    /// Busy fractions, that is, time in stages over the makespan: of the primary, and the mean of the other devices.
    pub primary_busy_share: Option<f64>,
    pub others_busy_share: Option<f64>,
    /// Time of each of [`PARTS`], ms.
    #[serde(rename = "stages", serialize_with = "by_column")]
    part_ms: [Option<f64>; PARTS.len()],
}

fn by_column<S: Serializer>(part_ms: &[Option<f64>; PARTS.len()], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(PARTS.iter().map(|part| part.column).zip(part_ms))
}

impl Run {
    /// Returns a row for each of [`ARRANGEMENTS`].
    pub fn rows(&self) -> [LeriaRow; 2] {
        let [baseline, proposed] = &self.frames;
        let gains = baseline.iter().zip(proposed).map(|(b, p)| b.makespan_ms / p.makespan_ms).collect();
        let speedups = [1.0, median_of(gains)];
        array::from_fn(|i| {
            let frames = &self.frames[i];
            let makespans_ms = || frames.iter().map(|f| f.makespan_ms);
            let median =
                |of: &dyn Fn(&FrameTimes) -> Option<f64>| super::median(frames.iter().filter_map(of).collect());
            LeriaRow {
                source: self.source,
                scene: self.shot.clone(),
                devices: Some(self.devices),
                arrangement: ARRANGEMENTS[i],
                frames: frames.len() as u32,
                total_s: Some(makespans_ms().sum::<f64>() / 1e3),
                makespan_ms: Some(quartiles(makespans_ms().collect())),
                speedup: speedups[i],
                primary_busy_share: median(&|f| f.busy_shares()[0]),
                others_busy_share: median(&|f| f.busy_shares()[1]),
                part_ms: array::from_fn(|part| median(&|f| f.part_ms[part])),
            }
        })
    }

    /// Plots the frames' makespans along the path.
    ///
    /// # Errors
    /// [`ReportError`] if there is nothing to draw.
    pub fn svg(&self) -> Result<String, ReportError> {
        let title = format!("{} on {} devices", self.shot, self.devices);
        let axis = |label: &str| Axis { label: label.to_owned(), log: false };
        let line = |(name, frames): (&str, &Vec<FrameTimes>)| {
            let points = (0u32..).zip(frames).map(|(i, f)| (f64::from(i), f.makespan_ms)).collect();
            Series { name: name.to_owned(), points, ..Series::default() }
        };
        let series: Vec<Series> = ARRANGEMENTS.into_iter().zip(&self.frames).map(line).collect();
        line_chart_svg(&Chart { title, x: axis("frame"), y: axis("makespan, ms") }, &series)
    }
}

/// Returns the rows with the paper's numbers. The paper lists times per stage only for its first scene.
fn cited() -> Vec<LeriaRow> {
    let row = |scene: usize, i: usize| {
        let ((name, total_s), is_detailed) = (CITED_S[scene], scene == 0);
        let [primary, others] = CITED_BUSY[i].map(|share| is_detailed.then_some(share));
        LeriaRow {
            source: "cited",
            scene: name.to_owned(),
            devices: None,
            arrangement: ARRANGEMENTS[i],
            frames: FRAMES,
            total_s: Some(total_s[i]),
            makespan_ms: None,
            speedup: total_s[0] / total_s[i],
            primary_busy_share: primary,
            others_busy_share: others,
            part_ms: array::from_fn(|part| is_detailed.then_some(PARTS[part].cited_ms[i])),
        }
    };
    (0..CITED_S.len()).flat_map(|scene| [row(scene, 0), row(scene, 1)]).collect()
}

/// Returns the rows of these runs, then the paper's.
pub fn rows(runs: &[Run]) -> Vec<LeriaRow> {
    runs.iter().flat_map(Run::rows).chain(cited()).collect()
}

const MAKESPANS: [Column<LeriaRow>; 10] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("devices", |r| r.devices.map_or("-".to_owned(), |n| n.to_string())),
    ("arrangement", |r| r.arrangement.to_owned()),
    ("frames", |r| r.frames.to_string()),
    ("all s", |r| cell(r.total_s, 3)),
    ("frame ms", |r| cell(r.makespan_ms.map(|ms| ms[1]), 1)),
    ("iqr ms", |r| cell(r.makespan_ms.map(|ms| ms[2] - ms[0]), 1)),
    ("speed-up", |r| format!("{:.2}", r.speedup)),
    ("busy, primary | others %", |r| {
        let percent = |share: Option<f64>| cell(share.map(|share| 100.0 * share), 0);
        format!("{} | {}", percent(r.primary_busy_share), percent(r.others_busy_share))
    }),
];

/// The caption of [`makespan_table`].
pub const MAKESPAN_NOTE: &str = "Baseline: the G-buffer and path tracing on all devices, all later stages on the \
    primary. Proposed: every stage on all devices. The two take turns frame by frame. frame ms: median makespan; iqr: \
    interquartile range. speed-up: the baseline's makespan over the proposed one's, median over frames. busy: time in \
    stages over the makespan, median over frames. Simulated: one frame on a virtual clock with the costs measured in \
    the proposed arrangement. Cited: Leria, Mäkitalo & Jääskeläinen 2024, several GPUs, 1280x720 per eye, 1 sample, 6 \
    bounces, SVGF; times of about 104 frames, and speed-ups computed from them, 2.25 on average.";

/// Returns a table with a line per arrangement.
pub fn makespan_table(rows: &[LeriaRow]) -> Table {
    table(&MAKESPANS, rows)
}

/// The caption of [`stage_table`].
pub const STAGE_NOTE: &str = "Time per frame in ms, both eyes: mean over the devices that run the stage, median over \
    frames. Denoising: every stage from accumulation to TAA and tonemapping, and the tallies. Sending and receiving: \
    host time in transfers, which other work may hide. Cited: San Miguel in the paper, where the baseline's times are \
    those of the primary, except for path tracing and sending, and the G-buffer is rasterised. The paper's scene \
    update, tonemapping, copy of the previous frame, stitching and blit have no stage of their own here.";

/// Returns a table with a line per stage of each run.
pub fn stage_table(runs: &[Run]) -> Table {
    let mut lines = Vec::new();
    for run in runs {
        let [baseline, proposed] = run.rows();
        for (i, part) in PARTS.iter().enumerate() {
            let own = [baseline.part_ms[i], proposed.part_ms[i]];
            let times = own[0].zip(own[1]).map(|(b, p)| b / p);
            let [cited_baseline, cited_proposed] = part.cited_ms;
            let mut line = vec![run.source.to_owned(), run.devices.to_string(), part.name.to_owned()];
            line.extend([cell(own[0], 2), cell(own[1], 2), cell(times, 2)]);
            line.extend([cited_baseline.to_string(), cited_proposed.to_string()]);
            line.push(format!("{:.2}", cited_baseline / cited_proposed));
            lines.push(line);
        }
    }
    let headers = vec![
        "source",
        "devices",
        "stage",
        "baseline",
        "proposed",
        "times",
        "cited baseline",
        "cited proposed",
        "cited times",
    ];
    Table { headers, rows: lines }
}

const CSV: [Column<LeriaRow>; 11] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("devices", |r| optional(r.devices)),
    ("arrangement", |r| r.arrangement.to_owned()),
    ("frames", |r| r.frames.to_string()),
    ("total_s", |r| number(r.total_s, 6)),
    ("makespan_ms", |r| number(r.makespan_ms.map(|ms| ms[1]), 4)),
    ("makespan_ms_iqr", |r| number(r.makespan_ms.map(|ms| ms[2] - ms[0]), 4)),
    ("speedup", |r| format!("{:.4}", r.speedup)),
    ("primary_busy_share", |r| number(r.primary_busy_share, 5)),
    ("others_busy_share", |r| number(r.others_busy_share, 5)),
];

/// Returns the contents of `leria.csv`: a line per arrangement, with the times of its stages.
pub fn leria_csv(rows: &[LeriaRow]) -> Csv {
    let stages = Csv {
        columns: PARTS.iter().map(|part| part.column.to_owned()).collect(),
        lines: rows.iter().map(|r| r.part_ms.iter().map(|ms| number(*ms, 4)).collect()).collect(),
    };
    Csv::new(&CSV, rows).beside(stages)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of the paper's three speedups is 2.25.
    #[test]
    fn cited_times_give_the_cited_speed_ups() {
        let speedups: Vec<f64> = cited().iter().skip(1).step_by(2).map(|row| row.speedup).collect();
        for (found, printed) in speedups.iter().zip([1.83, 2.80, 2.11]) {
            assert!((found - printed).abs() < 0.01, "{found} and {printed}");
        }
        let stages = ["reprojection", "hole filling", "denoising"].map(|name| {
            let part = PARTS.iter().find(|part| part.name == name).unwrap();
            part.cited_ms[0] / part.cited_ms[1]
        });
        assert!(stages.iter().zip([2.75, 2.89, 4.2]).all(|(found, printed)| (found - printed).abs() < 0.01));
    }

    fn run() -> Run {
        let frame = |makespan_ms, stages: &[(usize, &'static str, f64)]| {
            FrameTimes::new(makespan_ms, 3, stages.iter().copied())
        };
        let baseline = [(0, "path_trace", 4.0), (1, "path_trace", 4.0), (0, "svgf", 2.0), (0, "resolve", 1.0)];
        let sent = [(1, SENT, 1.0), (2, SENT, 3.0), (0, RECEIVED, 0.5)];
        let baseline = frame(10.0, &[&baseline[..], &sent].concat());
        let proposed = [5.0, 4.0, 1.0].map(|ms| frame(ms, &[(0, "svgf", 0.5), (1, "svgf", 1.0), (2, "svgf", 1.5)]));
        let frames = [vec![baseline; 3], proposed.to_vec()];
        Run { source: "measured", shot: "builtin:cornell".to_owned(), devices: 3, frames }
    }

    #[test]
    fn stages_are_means_over_the_devices_that_ran_them() {
        let [baseline, proposed] = run().rows();
        let ms = |row: &LeriaRow, name| row.part_ms[PARTS.iter().position(|part| part.name == name).unwrap()];
        let found =
            ["path tracing", "denoising", "sending", "receiving", "hole filling"].map(|name| ms(&baseline, name));
        assert_eq!(found, [Some(4.0), Some(3.0), Some(2.0), Some(0.5), None]);
        assert_eq!(ms(&proposed, "denoising"), Some(1.0));
        // Transfers do not count as work of the device; the third device did nothing.
        assert_eq!((baseline.primary_busy_share, baseline.others_busy_share), (Some(0.7), Some(0.2)));
        let lines = stage_table(&[run()]).rows;
        let line = lines.iter().find(|line| line[2] == "denoising").unwrap();
        assert_eq!(line[3..], ["3.00", "1.00", "3.00", "3.65", "0.87", "4.20"]);
    }

    #[test]
    fn speed_up_is_the_median_over_frames() {
        let rows = rows(&[run()]);
        assert_eq!(rows.len(), 2 + 2 * CITED_S.len());
        assert_eq!((rows[0].speedup, rows[1].speedup), (1.0, 2.5));
        let table = leria_csv(&rows);
        let found = ["source", "devices", "arrangement", "total_s", "makespan_ms", "speedup", "denoising_ms"];
        assert_eq!(
            found.map(|name| table.value(1, name)),
            ["measured", "3", "proposed", "0.010000", "4.0000", "2.5000", "1.0000"]
        );
        assert_eq!(
            found.map(|name| table.value(3, name)),
            ["cited", "", "proposed", "0.870000", "", "1.8276", "0.8700"]
        );
        assert_eq!(makespan_table(&rows).rows[2][9], "99 | 53");
    }
}
