//! Reports of frames: their times, tallies and plan.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::late_latching::SampledPose;
use super::messages::TaskTime;
use crate::graph::{Assignment, FrameGraph, Program, TaskKind, TimedTask, Work};
use crate::passes::path_trace::PARTITION;
use crate::passes::{FrameSpec, HoleReason, RowTally};
use crate::scene::rig::Eye;

/// Time of one task on one device, milliseconds since the renderer's origin.
#[derive(Clone, Debug, serde::Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    /// Duration that the cost model predicted; absent before it has learned from a frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub predicted_ms: Option<f64>,
    /// Number of submissions that the task was split into.
    pub submissions: u32,
    /// Number of the transfer within its frame. The download and the upload of a transfer have the same number.
    #[serde(skip)]
    pub transfer: Option<u32>,
    /// Index among the tasks of its device, in execution order.
    #[serde(skip)]
    pub number: usize,
    /// Dependencies of the task, each given by its device and its `number`.
    #[serde(skip)]
    pub after: Vec<(usize, usize)>,
}

impl TaskTiming {
    /// Describes a task whose execution time a device has measured. Returns `None` for the stitch, which takes no time.
    pub(super) fn of(graph: &FrameGraph, device: usize, time: &TaskTime, predicted_ms: Option<f64>) -> Option<Self> {
        let task = graph.tasks_of(device).get(time.task)?;
        let kind = graph.timed(task)?;
        let (stage, transfer) = match task.kind {
            TaskKind::Download { image, transfer, .. } | TaskKind::Upload { image, transfer } => {
                (graph.program.images()[image].name(), Some(transfer))
            }
            TaskKind::Dispatch { pass, .. } => (graph.program.passes()[pass].pass.stage.name().into(), None),
            TaskKind::Stitch => return None,
        };
        let TaskTime { begin_ms, end_ms, bytes, submissions, .. } = *time;
        let (view, device, rows) = (task.view, task.device, task.rows.clone());
        let (number, after) = (time.task, graph.dependencies(device, time.task));
        Some(Self {
            stage,
            kind,
            view,
            device,
            rows,
            begin_ms,
            end_ms,
            bytes,
            predicted_ms,
            submissions,
            transfer,
            number,
            after,
        })
    }
}

#[derive(Clone, Debug)]
pub struct FrameReport {
    pub index: u32,
    /// Time at which the frame was sent out, or at which the first device started it if devices were busy with another
    /// frame; milliseconds since the renderer's origin.
    pub begin_ms: f64,
    /// Time from `begin_ms` until the primary has the complete images: the frame's latency.
    pub makespan_ms: f64,
    /// Time between the ends of the previous frame and this one: the inverse of the throughput. `None` for the first
    /// frame.
    pub interval_ms: Option<f64>,
    /// Slot among the frames in flight, from 0.
    pub slot: usize,
    /// True if other frames were in flight with it.
    pub overlapped: bool,
    /// Makespan predicted by the cost model, in milliseconds. `None` before the model has learned from a frame, and for
    /// frames that overlap.
    pub predicted_ms: Option<f64>,
    /// Host time for planning stripes and graph, in milliseconds.
    pub plan_ms: f64,
    /// Tasks of all devices, sorted by device, then by begin time.
    pub tasks: Vec<TaskTiming>,
    /// Device numbers, each with the maximum error of the device's times so far, in microseconds.
    pub clock_residuals_us: Vec<(usize, f64)>,
    /// Totals per eye, over all rows.
    pub tallies: Vec<Tally>,
    /// Number of pixels of each eye's traced image.
    pub pixels: Vec<u64>,
    /// Tallies per eye and row.
    pub row_tallies: Vec<Vec<RowTally>>,
    /// Number of moving bodies left out of the frame: rays cannot intersect bodies that are too small, too stretched or
    /// too far away.
    pub bodies_left_out: u32,
    /// Devices that remained when the frame began.
    pub devices: Vec<usize>,
    /// Rank of each device of the run; empty in a run of one process.
    pub ranks: Vec<usize>,
    pub assignment: Assignment,
    /// Spec that the frame was planned with.
    pub spec: FrameSpec,
    /// Passes of the frame.
    pub program: Arc<Program>,
    /// Position within each pixel at which the auxiliary images are sampled, in pixels from its top left corner.
    pub pixel_centre: [f32; 2],
    /// Late-latched pose, if the frame has one.
    pub shown_from: Option<SampledPose>,
    /// Samples of each path-traced pixel if the frame ended early, see [`super::Renderer::render_watched`]. Pixels of
    /// hole filling may have fewer.
    pub spp_done: Option<u32>,
}

impl FrameReport {
    /// Returns the age of the late-latched pose at the end of the frame, in milliseconds.
    pub fn pose_age_ms(&self) -> Option<f64> {
        self.shown_from.as_ref().map(|pose| self.begin_ms + self.makespan_ms - pose.at_ms)
    }

    /// Returns the rows at which the main view's stripes of path tracing meet.
    pub fn stripe_edges(&self) -> &[u32] {
        self.assignment.stripes(PARTITION, self.program.main_eye()).inner_edges()
    }

    /// Returns the busy time by stage in milliseconds, summed over views and devices.
    pub fn stage_ms(&self) -> BTreeMap<String, f64> {
        let mut sums = BTreeMap::new();
        for task in self.tasks.iter().filter(|t| matches!(t.kind, TimedTask::Gpu(_))) {
            *sums.entry(task.stage.to_string()).or_default() += task.end_ms - task.begin_ms;
        }
        sums
    }

    /// Returns the rays per pixel of each stage that traces paths, without those of the G-buffer.
    pub fn stage_rays(&self) -> BTreeMap<String, f64> {
        let counts = self.program.passes().iter().map(|linked| &linked.pass).filter(|pass| pass.work == Work::Rays);
        let mut rays = BTreeMap::new();
        for pass in counts {
            let (tally, pixels) = (&self.tallies[pass.view.index()], self.pixels[pass.view.index()]);
            *rays.entry(pass.stage.name().to_owned()).or_default() +=
                tally.rays.saturating_sub(pixels) as f64 / pixels.max(1) as f64;
        }
        rays
    }

    /// Returns the busy time of each device of the run in milliseconds: the time that its queue spent executing stages.
    pub fn busy_ms(&self) -> Vec<f64> {
        let mut busy = vec![0.0; self.assignment.devices()];
        for task in self.tasks.iter().filter(|t| matches!(t.kind, TimedTask::Gpu(_))) {
            busy[task.device] += task.end_ms - task.begin_ms;
        }
        busy
    }

    /// Returns the tasks, with times relative to the start of the frame.
    pub fn tasks_since_begin(&self) -> Vec<TaskTiming> {
        let since = |ms: f64| ms - self.begin_ms;
        let task = |t: &TaskTiming| TaskTiming { begin_ms: since(t.begin_ms), end_ms: since(t.end_ms), ..t.clone() };
        self.tasks.iter().map(task).collect()
    }

    /// Returns which fractions of the right eye's pixels were reprojected, traced or filled in; with more views, the means
    /// of all reprojected ones. Returns `None` if no view was reprojected.
    pub fn right_eye(&self) -> Option<RightEye> {
        let reprojected = self.program.eyes().iter().copied().filter(|eye| self.spec.source(*eye).is_some());
        let of_view = |eye: Eye| (self.tallies[eye.index()], self.pixels[eye.index()]);
        let (tally, pixels) = reprojected.map(of_view).reduce(|(a, n), (b, m)| (a + b, n + m))?;
        Some(RightEye::of(&tally, pixels))
    }

    /// Returns the number of pixels of each view's image that start paths. For log-polar images it includes pixels
    /// outside the screen, which start none ([`crate::projection::PolarSpace::traced_fraction`]).
    pub fn traced_pixels(&self) -> Vec<u64> {
        let of_view = |eye: Eye| {
            let tally = &self.tallies[eye.index()];
            match self.spec.source(eye) {
                None => self.pixels[eye.index()] - tally.unsampled,
                Some(_) => tally.holes.iter().sum(),
            }
        };
        self.program.eyes().iter().copied().map(of_view).collect()
    }

    /// Returns the number of bytes of rows transferred between ranks; `None` in a run of one process.
    pub fn bytes_between_ranks(&self) -> Option<u64> {
        let transfers = |kind| self.tasks.iter().filter(move |t| t.kind == kind).filter_map(|t| Some((t.transfer?, t)));
        let from: HashMap<u32, usize> = transfers(TimedTask::Download).map(|(n, t)| (n, t.device)).collect();
        let rank = |device: usize| self.ranks.get(device);
        let crosses = |(n, t): &(u32, &TaskTiming)| from.get(n).is_some_and(|&from| rank(from) != rank(t.device));
        let bytes = transfers(TimedTask::Upload).filter(crosses).filter_map(|(_, t)| t.bytes);
        (!self.ranks.is_empty()).then(|| bytes.sum())
    }

    /// Returns the number of bytes of rows transferred between devices.
    pub fn uploaded_bytes(&self) -> u64 {
        self.tasks.iter().filter(|t| t.kind == TimedTask::Upload).filter_map(|t| t.bytes).sum()
    }
}

/// Counts of rays and pixels of one view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub rays: u64,
    pub nonfinite: u64,
    /// Number of pixels that could not be reprojected, by [`crate::passes::HoleReason`].
    pub holes: [u64; 6],
    /// Number of pixels that were not traced. The denoiser fills them in.
    pub unsampled: u64,
    /// Number of pixels whose radiance exceeded the range of half floats.
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

impl std::ops::Add for Tally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            rays: self.rays + other.rays,
            nonfinite: self.nonfinite + other.nonfinite,
            holes: std::array::from_fn(|i| self.holes[i] + other.holes[i]),
            unsampled: self.unsampled + other.unsampled,
            clipped: self.clipped + other.clipped,
        }
    }
}

/// Fractions of a reprojected right eye's pixels by the way in which they were computed.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RightEye {
    /// Reprojected from the left eye, or without a surface.
    pub reprojected_fraction: f64,
    /// Traced, since several surfaces with different radiance share the pixel in either eye.
    pub antialiasing_fraction: f64,
    /// Traced, since the surface is disoccluded, or its radiance differs in the left eye.
    pub hole_fraction: f64,
    /// `hole_fraction` by [`HoleReason`].
    pub hole_fractions: BTreeMap<String, f64>,
    /// Not traced but filled in by the denoiser, due to render scale or foveation.
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
            write!(f, "{} filled in by the denoiser, ", percent(self.unsampled_fraction))?;
        }
        write!(f, "{} holes", percent(self.hole_fraction))?;
        if self.hole_fraction > 0.0 {
            let hidden = of(&[HoleReason::Normal, HoleReason::Distance, HoleReason::Material]);
            write!(f, " ({} outside the left image, {hidden} disoccluded, ", of(&[HoleReason::Outside]))?;
            write!(f, "{} mirrors, glass or gloss)", of(&[HoleReason::View]))?;
        }
        Ok(())
    }
}
