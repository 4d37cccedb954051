//! What a frame took and found.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::late::SampledPose;
use super::messages::TaskTime;
use crate::graph::{Assignment, FrameGraph, Program, Stage, TaskKind};
use crate::passes::path_trace::CUT;
use crate::passes::{FrameSpec, HoleReason, RowTally, Views};
use crate::scene::rig::Eye;

/// Time of one task on one device, milliseconds since the renderer's origin.
#[derive(Clone, Debug, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TaskTiming {
    /// The stage, or the image that is transferred.
    pub stage: Cow<'static, str>,
    #[serde(skip)]
    pub kind: TimedTask,
    pub view: Eye,
    pub device: usize,
    pub rows: Range<u32>,
    pub begin_ms: f64,
    pub end_ms: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// How many submissions it was spread over.
    pub submissions: u32,
    /// Number of the transfer within its frame; both of its ends have it.
    #[serde(skip)]
    pub transfer: Option<u32>,
    /// Its number among the tasks of its device, in the order in which the device carries them out.
    #[serde(skip)]
    pub number: usize,
    /// The tasks that it depends on, by device and number.
    #[serde(skip)]
    pub after: Vec<(usize, usize)>,
}

impl TaskTiming {
    /// From what a device says of one of its tasks; none if that is nothing that takes time.
    pub(super) fn of(graph: &FrameGraph, device: usize, time: &TaskTime) -> Option<Self> {
        let task = graph.tasks_of(device).get(time.task)?;
        let name = |image: usize| graph.program.images()[image].name();
        let (stage, kind, transfer) = match task.kind {
            TaskKind::Dispatch { pass, .. } => {
                let stage = graph.program.passes()[pass].pass.stage;
                (stage.name().into(), TimedTask::Gpu(stage), None)
            }
            TaskKind::Download { image, transfer, .. } => (name(image), TimedTask::Download, Some(transfer)),
            TaskKind::Upload { image, transfer } => (name(image), TimedTask::Upload, Some(transfer)),
            TaskKind::Stitch => return None,
        };
        let TaskTime { begin_ms, end_ms, bytes, submissions, .. } = *time;
        let (view, device, rows) = (task.view, task.device, task.rows.clone());
        let (number, after) = (time.task, graph.dependencies(device, time.task));
        Some(Self { stage, kind, view, device, rows, begin_ms, end_ms, bytes, submissions, transfer, number, after })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimedTask {
    /// On the device's own clock.
    Gpu(Stage),
    /// Rows taken from the device's memory to the host's.
    Download,
    /// Rows handed to the device.
    Upload,
}

#[derive(Clone, Debug)]
pub struct FrameReport {
    pub index: u32,
    /// When the first task was handed out, or the first device turned to the frame if it was busy with another;
    /// milliseconds since the renderer's origin.
    pub begin_ms: f64,
    /// From there to the whole images on the primary: the frame's latency.
    pub makespan_ms: f64,
    /// Between its end and that of the frame before, which is what throughput follows from; none for a first frame.
    pub interval_ms: Option<f64>,
    /// Which of the frames that may be in flight together it is, from 0.
    pub slot: usize,
    /// Whether others were on the devices with it.
    pub overlapped: bool,
    /// The makespan that the cost model predicted; none before it has learned from a frame, and none for frames that
    /// overlap.
    pub predicted_ms: Option<f64>,
    /// Host time to make stripes and graph, milliseconds.
    pub plan_ms: f64,
    /// By device, in order of begin.
    pub tasks: Vec<TaskTiming>,
    /// How wrong times of each device have been at most, up to this frame.
    pub clock_residuals_us: Vec<(usize, f64)>,
    /// Per eye, summed over rows.
    pub tallies: [Tally; 2],
    /// Of each eye's image that is traced.
    pub pixels: [u64; 2],
    /// Per eye and row.
    pub row_tallies: [Vec<RowTally>; 2],
    /// The number of moving bodies that it lacks: rays cannot follow what is too small, too stretched or too far away.
    pub bodies_left_out: u32,
    /// Those that were left when it was begun.
    pub devices: Vec<usize>,
    /// The rank of each device of the run; none in a run of one process.
    pub ranks: Vec<usize>,
    pub assignment: Assignment,
    /// What it had to do.
    pub spec: FrameSpec,
    /// Its passes.
    pub program: Arc<Program>,
    /// The point of each pixel, from its top left corner, that its auxiliary images are of.
    pub pixel_centre: [f32; 2],
    /// The pose that it was shown from, where that was asked for at the end.
    pub shown_from: Option<SampledPose>,
}

impl FrameReport {
    /// From when the pose was asked for that it was shown from to its end, milliseconds.
    pub fn pose_age_ms(&self) -> Option<f64> {
        self.shown_from.as_ref().map(|pose| self.begin_ms + self.makespan_ms - pose.at_ms)
    }

    /// Rows at which one device's part of the left eye's path tracing ends and the next one's begins.
    pub fn stripe_edges(&self) -> &[u32] {
        self.assignment.stripes(CUT, Eye::Left).inner_edges()
    }

    /// Busy time by stage, summed over views and devices.
    pub fn stage_ms(&self) -> BTreeMap<String, f64> {
        let mut sums = BTreeMap::new();
        for task in self.tasks.iter().filter(|t| matches!(t.kind, TimedTask::Gpu(_))) {
            *sums.entry(task.stage.to_string()).or_default() += task.end_ms - task.begin_ms;
        }
        sums
    }

    /// Per device of the run, the time in which its queue ran stages, milliseconds.
    pub fn busy_ms(&self) -> Vec<f64> {
        let mut busy = vec![0.0; self.assignment.devices()];
        for task in self.tasks.iter().filter(|t| matches!(t.kind, TimedTask::Gpu(_))) {
            busy[task.device] += task.end_ms - task.begin_ms;
        }
        busy
    }

    /// The tasks, with times since the frame's begin.
    pub fn tasks_since_begin(&self) -> Vec<TaskTiming> {
        let since = |ms: f64| ms - self.begin_ms;
        let task = |t: &TaskTiming| TaskTiming { begin_ms: since(t.begin_ms), end_ms: since(t.end_ms), ..t.clone() };
        self.tasks.iter().map(task).collect()
    }

    /// How the right eye's pixels came about; `None` where it was traced as the left one was.
    pub fn right_eye(&self) -> Option<RightEye> {
        (self.spec.views == Views::Reprojected).then(|| RightEye::of(&self.tallies[1], self.pixels[1]))
    }

    /// Pixels of each eye's image that start paths; of log-polar images also those that would show what is beside the
    /// screen, which do not ([`crate::stages::Polar::traced_share`]).
    pub fn traced_pixels(&self) -> [u64; 2] {
        let sampled = |eye: usize| self.pixels[eye] - self.tallies[eye].unsampled;
        match self.spec.views {
            Views::Traced => [sampled(0), sampled(1)],
            Views::Reprojected => [sampled(0), self.tallies[1].holes.iter().sum()],
        }
    }

    /// Bytes that crossed from rank to rank; none in a run of one process.
    pub fn bytes_between_ranks(&self) -> Option<u64> {
        let transfers = |kind| self.tasks.iter().filter(move |t| t.kind == kind).filter_map(|t| Some((t.transfer?, t)));
        let from: HashMap<u32, usize> = transfers(TimedTask::Download).map(|(n, t)| (n, t.device)).collect();
        let rank = |device: usize| self.ranks.get(device);
        let crosses = |(n, t): &(u32, &TaskTiming)| from.get(n).is_some_and(|&from| rank(from) != rank(t.device));
        let bytes = transfers(TimedTask::Upload).filter(crosses).filter_map(|(_, t)| t.bytes);
        (!self.ranks.is_empty()).then(|| bytes.sum())
    }

    /// Bytes that crossed from device to device.
    pub fn uploaded_bytes(&self) -> u64 {
        self.tasks.iter().filter(|t| t.kind == TimedTask::Upload).filter_map(|t| t.bytes).sum()
    }
}

/// Totals of one view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub rays: u64,
    pub nonfinite: u64,
    /// By [`crate::passes::HoleReason`].
    pub holes: [u64; 6],
    /// Pixels left to the filter.
    pub unsampled: u64,
    /// Pixels whose light was too bright for half floats.
    pub clipped: u64,
}

impl Tally {
    pub fn of(rows: &[RowTally]) -> Self {
        let mut sum = Self::default();
        for row in rows {
            sum.rays += u64::from(row.rays);
            sum.nonfinite += u64::from(row.nonfinite);
            sum.unsampled += u64::from(row.unsampled);
            sum.clipped += u64::from(row.clipped);
            for (s, h) in sum.holes.iter_mut().zip(row.holes) {
                *s += u64::from(h);
            }
        }
        sum
    }
}

/// How the pixels of a right eye that is reprojected came about: shares that sum to 1.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RightEye {
    /// Gathered from the left eye, or without a surface.
    pub reprojected_fraction: f64,
    /// Traced, since several surfaces share the pixel, here or in the left eye: each has light of its own.
    pub antialiasing_fraction: f64,
    /// Traced, since the left eye did not see the surface, or saw other light from there.
    pub hole_fraction: f64,
    /// The same by [`HoleReason`].
    pub hole_fractions: BTreeMap<String, f64>,
    /// Not traced but left to the filter, by render scale or foveation.
    pub unsampled_fraction: f64,
}

impl RightEye {
    fn of(tally: &Tally, all: u64) -> Self {
        let share = |pixels: u64| pixels as f64 / all as f64;
        let reasons = HoleReason::ALL.into_iter().filter(|reason| *reason != HoleReason::Mixed);
        let mixed = tally.holes[HoleReason::Mixed as usize];
        let traced: u64 = tally.holes.iter().sum();
        Self {
            reprojected_fraction: share(all.saturating_sub(traced + tally.unsampled)),
            antialiasing_fraction: share(mixed),
            hole_fraction: share(traced - mixed),
            hole_fractions: reasons.map(|r| (r.name().to_owned(), share(tally.holes[r as usize]))).collect(),
            unsampled_fraction: share(tally.unsampled),
        }
    }
}

impl fmt::Display for RightEye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let of = |reasons: &[HoleReason]| percent(reasons.iter().map(|r| self.hole_fractions[r.name()]).sum());
        write!(f, "{} reprojected, ", percent(self.reprojected_fraction))?;
        write!(f, "{} traced again for antialiasing, ", percent(self.antialiasing_fraction))?;
        if self.unsampled_fraction > 0.0 {
            write!(f, "{} left to the filter, ", percent(self.unsampled_fraction))?;
        }
        write!(f, "{} holes", percent(self.hole_fraction))?;
        if self.hole_fraction > 0.0 {
            let hidden = of(&[HoleReason::Normal, HoleReason::Distance, HoleReason::Material]);
            write!(f, " ({} outside the left image, {hidden} hidden from the left eye, ", of(&[HoleReason::Outside]))?;
            write!(f, "{} mirrors, glass or gloss)", of(&[HoleReason::View]))?;
        }
        Ok(())
    }
}

/// Both eyes.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Stereo<T> {
    pub left: T,
    pub right: T,
}
