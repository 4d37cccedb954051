//! Rows of `run.json`: the measurements of a frame, and the decision of the control loop for it.

use std::collections::BTreeMap;

use serde::ser::{Error, SerializeSeq, Serializer};
use serde::{Deserialize, Serialize};

use super::headset::HeadsetRow;
use super::lanes::round;
use super::once;
use diptych::control::{Budget, Decision};
use diptych::exec::{FrameReport, PerView, RightEye, TaskTiming, TimedTask};
use diptych::graph::{Seam, Stage};
use diptych::passes::AOVS;
use diptych::passes::path_trace::PARTITION;
use diptych::quality::{FrameQuality, Quality};
use diptych::scene::projection::Matrices;
use diptych::scene::rig::{Eye, Rig};
use diptych::session::Decided;
use diptych::trace::deadline::Presented;
use diptych::trace::intervals;

/// Decision of the control loop for a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ControlRow {
    /// Index of the rung in the ladder, from 0.
    pub rung: usize,
    /// Expected time of the rung: the cost model's prediction after correction.
    pub expected_ms: f64,
    /// True if any rung was expected to fit the budget.
    pub fits: bool,
    pub in_band: bool,
    /// Delay of the frame's start after the time at which it was due, one period after the start of the frame before it.
    pub late_ms: f64,
    /// Host time for choosing the rung.
    pub decide_ms: f64,
    /// Number of refreshes of the display, at the session's frame rate, at which the frame was due but not complete. In
    /// a headset: number of periods without a new frame before this one, by the runtime's predictions.
    pub missed_periods: u32,
}

impl ControlRow {
    /// Describes a frame that began `late_ms` after it was due. It has missed no display period yet.
    pub fn new(decided: Decided, budget: Budget, makespan_ms: f64, late_ms: f64) -> Self {
        let Decided { decision: Decision { rung, expected_ms, fits }, decide_ms } = decided;
        let in_band = (budget.lo_ms()..=budget.hi_ms()).contains(&makespan_ms);
        Self { rung, expected_ms, fits, in_band, late_ms, decide_ms, missed_periods: 0 }
    }
}

/// Time of a frame on a display, from its start until the host had the complete frame, and its deadline.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DeadlineRow {
    /// Sum of the makespan and the host time before and after it.
    pub whole_ms: f64,
    pub host_before_ms: f64,
    pub host_after_ms: f64,
    /// Time by which the frame missed its deadline; negative for a frame in time.
    pub over_deadline_ms: f64,
    /// Fraction of the cores that other programs took around the frame, if the system tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub others_share: Option<f64>,
    /// Cause of the missed deadline; absent for a frame in time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
}

impl DeadlineRow {
    pub fn new(frame: &FrameReport, shown: &Presented) -> Self {
        let Presented { deadline, cause, around } = shown;
        let [host_before_ms, host_after_ms] = deadline.host_ms(frame);
        Self {
            whole_ms: deadline.whole_ms(),
            host_before_ms,
            host_after_ms,
            over_deadline_ms: deadline.over_ms(),
            others_share: around.others,
            cause: cause.clone(),
        }
    }
}

/// Work of one device on one stage and view of a frame. Transfers of rows count as the stages `download` and `upload`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StageSum {
    pub stage: &'static str,
    pub view: Eye,
    pub device: usize,
    /// Total duration of the tasks, rounded to microseconds.
    pub busy_ms: f64,
    /// Number of transferred bytes; absent for other stages than `download` and `upload`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
}

impl StageSum {
    /// Sums up `tasks` by stage, view and device. The sums are in the order of their first tasks.
    fn of(tasks: &[TaskTiming]) -> Vec<Self> {
        let mut sums: Vec<Self> = Vec::new();
        for &TaskTiming { kind, view, device, begin_ms, end_ms, bytes, .. } in tasks {
            let (stage, busy_ms) = (kind.name(), end_ms - begin_ms);
            match sums.iter_mut().find(|s| (s.stage, s.view, s.device) == (stage, view, device)) {
                Some(sum) => {
                    sum.busy_ms += busy_ms;
                    sum.bytes = sum.bytes.zip(bytes).map(|(sum, more)| sum + more);
                }
                None => sums.push(Self { stage, view, device, busy_ms, bytes }),
            }
        }
        sums.iter_mut().for_each(|sum| sum.busy_ms = round(sum.busy_ms));
        sums
    }
}

/// Returns the time in milliseconds that passes and transfers of auxiliary images took on the device where they took
/// longest. Overlapping tasks count once.
pub fn aov_ms(tasks: &[TaskTiming]) -> f64 {
    let of = |device: usize| {
        let own = tasks.iter().filter(|t| t.device == device && AOVS.iter().any(|stage| t.stage == stage.name()));
        intervals::length(&intervals::union(own.map(|t| (t.begin_ms, t.end_ms)).collect()))
    };
    once(tasks.iter().map(|t| t.device)).into_iter().map(of).fold(0.0, f64::max)
}

/// Measurements of a frame. For an accumulated reference, the numbers are sums over this run's accumulation passes,
/// except that stages, tasks and `aov_ms` describe the last pass.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FrameRow {
    pub index: u32,
    /// Scene time of the frame.
    pub time_s: f64,
    /// Camera of each eye.
    pub cameras: PerView<Matrices>,
    /// Number of devices that rendered the frame.
    pub devices: usize,
    /// Time from the start of the frame until the images on the primary are complete, without `aov_ms`.
    pub makespan_ms: f64,
    /// Time from the end of the previous frame to the end of this one; `null` for the first frame and for a reference.
    pub interval_ms: Option<f64>,
    /// Makespan predicted by the cost model, without `aov_ms`. It is `null` before the model has learned from a frame,
    /// and for frames that overlap with others in flight.
    pub predicted_ms: Option<f64>,
    /// Time of passes and transfers of auxiliary images, on the device on which they took longest.
    pub aov_ms: f64,
    /// Host time for distributing rows and building the graph.
    pub plan_ms: f64,
    #[serde(flatten)]
    pub quality: FrameQuality,
    pub rays: u64,
    /// Fractions of the right eye's pixels by origin, if that eye is reprojected.
    #[serde(flatten)]
    pub right_eye: Option<RightEye>,
    pub nonfinite_samples: u64,
    /// Traced pixels of both eyes whose demodulated illumination was clipped to the range of half floats, at least 46,000
    /// times white. Only `svgf` with specular surfaces stores half floats.
    pub clipped_pixels: u64,
    /// Number of rows of the left eye that each device path traced.
    pub stripes: Vec<u32>,
    /// Number of rows per device, for each stage and view that ran. Keys are `STAGE.VIEW`.
    pub stage_stripes: BTreeMap<String, Vec<u32>>,
    pub transferred_bytes: u64,
    /// Number of bytes transferred between processes; absent in a run of a single process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_between_ranks: Option<u64>,
    /// Search range of history: the number of rows above and below a pixel; `null` without history.
    pub history_rows: Option<u32>,
    /// Indices of the filter passes before which devices exchange halos.
    pub halo_exchanges: Vec<usize>,
    pub stages: Vec<StageSum>,
    /// Tasks, with times since the start of the frame. Only with `--also details` or, in `play`, `details=on`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tasks: Vec<TaskTiming>,
    /// Decision of the control loop, for frames with a time budget.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlRow>,
    /// Deadline of the frame, if it was to appear on a display.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub deadline: Option<DeadlineRow>,
    /// Timing in a headset, if the frame was shown in one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub headset: Option<HeadsetRow>,
    /// Number of dynamic bodies that the frame omits, because they were too small, too stretched or too far away.
    pub bodies_left_out: u32,
    /// Samples per pixel of a still that a signal ended early; pixels of hole filling may have fewer. Absent for other
    /// frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spp_done: Option<u32>,
}

impl FrameRow {
    /// Creates the row of a frame at scene time `time_s`, seen through the cameras of `rig`.
    pub fn new(frame: &FrameReport, quality: &Quality, rig: &Rig, time_s: f64) -> Self {
        let matrices = |eye| rig.matrices(time_s, eye, frame.spec.chain.displayed);
        let rows_of = |group, view| {
            let stripes = frame.assignment.stripes(group, view);
            (0..stripes.devices()).map(|d| stripes.rows(d).len() as u32).collect::<Vec<u32>>()
        };
        let ran = frame.tasks.iter().filter_map(|t| match t.kind {
            TimedTask::Gpu(stage) => Some((stage, t.view)),
            TimedTask::Download | TimedTask::Upload => None,
        });
        let passes = || frame.program.passes().iter().map(|p| &p.pass);
        let group_of = |stage, view| passes().find(|p| (p.stage, p.view) == (stage, view)).map(|p| p.partition);
        let rows = |(s, v): (Stage, Eye)| Some((format!("{}.{v}", s.name()), rows_of(group_of(s, v)?, v)));
        let stage_stripes = once(ran).into_iter().filter_map(rows).collect();
        let aov_ms = aov_ms(&frame.tasks);
        Self {
            index: frame.index,
            time_s,
            cameras: rig.eyes().map(matrices).collect(),
            devices: frame.devices.len(),
            makespan_ms: frame.makespan_ms - aov_ms,
            interval_ms: frame.interval_ms,
            predicted_ms: frame.predicted_ms.map(|ms| ms - aov_ms),
            aov_ms: round(aov_ms),
            plan_ms: frame.plan_ms,
            quality: quality.into(),
            rays: frame.tallies.iter().map(|t| t.rays).sum(),
            right_eye: frame.right_eye(),
            nonfinite_samples: frame.tallies.iter().map(|t| t.nonfinite).sum(),
            clipped_pixels: frame.tallies.iter().map(|t| t.clipped).sum(),
            stripes: rows_of(PARTITION, frame.program.main_eye()),
            stage_stripes,
            transferred_bytes: frame.uploaded_bytes(),
            bytes_between_ranks: frame.bytes_between_ranks(),
            history_rows: frame.spec.history_rows,
            halo_exchanges: match frame.spec.seam {
                Seam::Halo(plan) => (0..frame.program.links()).filter(|i| plan.receives_before(*i)).collect(),
                Seam::None | Seam::Filter => Vec::new(),
            },
            stages: StageSum::of(&frame.tasks),
            tasks: Vec::new(),
            control: None,
            deadline: None,
            headset: None,
            bodies_left_out: frame.bodies_left_out,
            spp_done: frame.spp_done,
        }
    }

    /// Sets the number of display periods that the frame missed, if it has a control decision.
    pub fn miss(&mut self, periods: u32) {
        self.control.iter_mut().for_each(|control| control.missed_periods = periods);
    }

    /// Adds the frame's tasks.
    pub fn with_tasks(self, frame: &FrameReport) -> Self {
        Self { tasks: frame.tasks_since_begin(), ..self }
    }
}

/// Rows of frames, in memory or in a file.
pub trait FrameRows {
    /// Serializes the rows as a list with one line per row, since a row has hundreds of numbers.
    ///
    /// # Errors
    /// Errors of the serializer and of reading the file.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error>;
}

impl FrameRows for Vec<FrameRow> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let line = |row| serde_json::value::to_raw_value(row).map_err(S::Error::custom);
        let mut list = serializer.serialize_seq(Some(self.len()))?;
        self.iter().try_for_each(|row: &FrameRow| list.serialize_element(&line(row)?))?;
        list.end()
    }
}
