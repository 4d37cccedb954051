//! Summarises a trace: utilisation of each device, overlap between devices, frame times, and critical paths.

use std::collections::{BTreeMap, HashSet};

use serde::{Deserialize, Serialize};

use super::critical::{Stretch, What, critical_path};
use super::intervals::{Interval, length, length_in_two_or_more, shared_length, union};
pub use super::median::median;
use super::rank_transfers::RankTransferSummary;
use super::work::{Device, Frame, FrameTime, Trace, extent};
use super::{Lane, TraceError};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceSummary {
    pub pid: u32,
    pub name: String,
    /// Time in which work on the left eye, the right eye or both ran.
    pub busy_ms: f64,
    /// Time in which an upload or download ran.
    pub transfer_ms: f64,
    /// Part of `transfer_ms` in which the device was busy, too.
    pub hidden_transfer_ms: f64,
    /// Idle time within the frames that the device took part in: it was neither busy nor transferring.
    pub idle_ms: f64,
    /// `busy_ms` as a fraction of the time of the frames that the device took part in.
    pub busy_share: f64,
    /// Error bound of the device's times, converted to the host's clock.
    pub clock_residual_us: Option<f64>,
}

/// Work of one stage on one eye, or all uploads or downloads, summed over devices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// Name of the stage, or `rows` for transfers.
    pub stage: String,
    pub lane: Lane,
    pub time_ms: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameSummary {
    pub frame: u64,
    /// Time since the first frame's begin.
    pub begin_ms: f64,
    /// Time from the start of planning until the images are complete on the primary. If the trace does not record it,
    /// the time from the first task's begin to the last task's end.
    pub makespan_ms: f64,
    /// Busy time of all devices together.
    pub busy_ms: f64,
    pub transfer_ms: f64,
    pub idle_ms: f64,
    /// Largest over mean busy time of the devices; none if no device was busy.
    pub imbalance: Option<f64>,
    /// Total wait on the critical path.
    pub wait_ms: f64,
    /// Number of bytes that were uploaded to devices.
    pub bytes: u64,
    pub stages: Vec<StageTime>,
}

/// Contribution of one stage, transfer or wait of one device to the critical paths of the frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathShare {
    /// Name of the stage, the transferred image, or the cause of the wait.
    pub what: String,
    /// Lane of a task; none for a wait.
    pub lane: Option<Lane>,
    pub pid: u32,
    /// Mean over frames.
    pub ms_per_frame: f64,
    /// Fraction of the sum of all frames' makespans.
    pub share: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    pub devices: Vec<DeviceSummary>,
    /// Frames of the trace; empty if its tasks do not say which frame they belong to.
    pub frames: Vec<FrameSummary>,
    /// Time covered by frames, without gaps and with overlaps counted once. In a trace without frames, the time from
    /// the first begin to the last end on any device.
    pub total_ms: f64,
    /// Time in which at least two devices were busy, over `total_ms`.
    pub overlap_share: f64,
    /// Fraction of the transfer time in which the transferring device was busy, too; none without transfers.
    pub hidden_transfer_share: Option<f64>,
    /// Largest over mean busy time of the devices; 1 is perfect balance. None if no device was busy.
    pub imbalance: Option<f64>,
    /// Parts of the critical paths, longest first. Together they add up to the mean makespan.
    pub critical_path: Vec<PathShare>,
    /// Summary of transfers of rows between ranks; none without such transfers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passages: Option<RankTransferSummary>,
    pub warnings: Vec<String>,
}

/// One frame, with its critical path step by step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameDetail {
    pub summary: Summary,
    pub steps: Vec<Step>,
}

/// A stretch of the critical path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Stage, transfer or wait, as in [`PathShare::what`].
    pub what: String,
    pub lane: Option<Lane>,
    pub pid: u32,
    /// Time since the frame's begin.
    pub begin_ms: f64,
    pub time_ms: f64,
    /// Duration that the cost model predicted for the task, if known.
    #[serde(default)]
    pub predicted_ms: Option<f64>,
    /// Rows of the task: the first, and the one after the last; none for a wait.
    pub rows: Option<[u64; 2]>,
}

impl Summary {
    pub fn of(trace: &Trace) -> Summary {
        let frames = trace.frames();
        let mut warnings = trace.warnings.clone();
        if trace.tasks.is_empty() {
            warnings.push("there is no device work in this trace".to_owned());
        }
        if frames.is_empty() {
            let (begin_us, end_us) = extent(&trace.tasks).unwrap_or_default();
            let whole = Frame {
                time: FrameTime { frame: 0, begin_us, end_us, devices: None },
                tasks: trace.tasks.iter().collect(),
            };
            return Summary { frames: Vec::new(), critical_path: Vec::new(), ..sum_up(trace, &[whole], warnings) };
        }
        let outside = trace.tasks.iter().filter(|task| task.frame.is_none()).count();
        if outside > 0 {
            warnings.push(format!("{outside} device tasks without a frame number are left out"));
        }
        sum_up(trace, &frames, warnings)
    }
}

impl FrameDetail {
    /// Returns frame `number` of the trace with its critical path.
    ///
    /// # Errors
    /// [`TraceError::NoFrames`], [`TraceError::NoSuchFrame`]; their messages name the trace by `origin`.
    pub fn of(trace: &Trace, number: u64, origin: &str) -> Result<FrameDetail, TraceError> {
        let frames = trace.frames();
        let path = origin.to_owned();
        let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
            return Err(TraceError::NoFrames { path });
        };
        let Some(frame) = frames.iter().find(|f| f.time.frame == number) else {
            let (first, last, count) = (first.time.frame, last.time.frame, frames.len());
            return Err(TraceError::NoSuchFrame { path, frame: number, count, first, last });
        };
        let summary = sum_up(trace, std::slice::from_ref(frame), trace.warnings.clone());
        Ok(FrameDetail { steps: Step::path(frame), summary })
    }
}

impl Step {
    /// Returns the critical path of a frame.
    pub fn path(frame: &Frame<'_>) -> Vec<Self> {
        let step = |stretch: Stretch<'_>| {
            let (what, lane) = name(&stretch.what);
            let task = match stretch.what {
                What::Task(task) => Some(task),
                What::Wait(_) => None,
            };
            Self {
                what,
                lane,
                pid: stretch.pid,
                begin_ms: (stretch.begin_us - frame.time.begin_us) / 1000.0,
                time_ms: (stretch.end_us - stretch.begin_us) / 1000.0,
                predicted_ms: task.and_then(|task| task.predicted_us).map(|us| us / 1000.0),
                rows: task.and_then(|task| task.rows.as_ref()).map(|rows| [rows.start, rows.end]),
            }
        };
        critical_path(frame).into_iter().map(step).collect()
    }
}

fn sum_up(trace: &Trace, frames: &[Frame], warnings: Vec<String>) -> Summary {
    let total_us = time_of(frames.iter());
    let lanes = lanes(trace, frames);
    let overlap_us = length_in_two_or_more(lanes.iter().map(|device| &device.busy));
    let devices: Vec<_> = lanes.iter().map(Lanes::sum_up).collect();
    let transfer_ms: f64 = devices.iter().map(|d| d.transfer_ms).sum();
    let hidden_ms: f64 = devices.iter().map(|d| d.hidden_transfer_ms).sum();
    let zero_us = frames.first().map_or(0.0, |f| f.time.begin_us);
    let numbers: HashSet<u64> = frames.iter().map(|f| f.time.frame).collect();
    let paths: Vec<Vec<Stretch<'_>>> = frames.iter().map(critical_path).collect();
    Summary {
        frames: frames.iter().zip(&paths).map(|(frame, path)| frame_summary(trace, frame, path, zero_us)).collect(),
        total_ms: total_us / 1000.0,
        overlap_share: share(overlap_us, total_us),
        hidden_transfer_share: (transfer_ms > 0.0).then(|| hidden_ms / transfer_ms),
        imbalance: imbalance(&devices),
        critical_path: path_shares(frames, &paths),
        passages: RankTransferSummary::of(&trace.passages, |frame| numbers.contains(&frame)),
        devices,
        warnings,
    }
}

/// Returns the time covered by the frames, microseconds. Gaps between them do not count, and overlaps count once.
fn time_of<'a>(frames: impl Iterator<Item = &'a Frame<'a>>) -> f64 {
    length(&union(frames.map(|f| (f.time.begin_us, f.time.end_us)).collect()))
}

fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

fn imbalance(devices: &[DeviceSummary]) -> Option<f64> {
    let busy_ms = devices.iter().map(|device| device.busy_ms);
    let (total_ms, most_ms) = busy_ms.fold((0.0, 0.0f64), |(sum, max), ms| (sum + ms, max.max(ms)));
    (total_ms > 0.0).then(|| most_ms * devices.len() as f64 / total_ms)
}

fn frame_summary(trace: &Trace, frame: &Frame, path: &[Stretch<'_>], zero_us: f64) -> FrameSummary {
    let devices: Vec<_> = lanes(trace, std::slice::from_ref(frame)).iter().map(Lanes::sum_up).collect();
    let sum = |of: fn(&DeviceSummary) -> f64| devices.iter().map(of).sum();
    let waits = path.iter().filter(|stretch| matches!(stretch.what, What::Wait(_)));
    let uploads = frame.tasks.iter().filter(|task| task.lane == Lane::Upload);
    FrameSummary {
        frame: frame.time.frame,
        begin_ms: (frame.time.begin_us - zero_us) / 1000.0,
        makespan_ms: frame.time.length_us() / 1000.0,
        busy_ms: sum(|d| d.busy_ms),
        transfer_ms: sum(|d| d.transfer_ms),
        idle_ms: sum(|d| d.idle_ms),
        imbalance: imbalance(&devices),
        wait_ms: waits.map(|wait| (wait.end_us - wait.begin_us) / 1000.0).sum(),
        bytes: uploads.filter_map(|task| task.bytes).fold(0, u64::saturating_add),
        stages: stage_times(frame),
    }
}

fn stage_times(frame: &Frame) -> Vec<StageTime> {
    let mut times_ms: BTreeMap<(&str, Lane), f64> = BTreeMap::new();
    for task in &frame.tasks {
        let stage = if task.lane.is_transfer() { "rows" } else { &task.name };
        *times_ms.entry((stage, task.lane)).or_default() += (task.end_us - task.begin_us) / 1000.0;
    }
    let times = times_ms.into_iter();
    times.map(|((stage, lane), time_ms)| StageTime { stage: stage.to_owned(), lane, time_ms }).collect()
}

fn name(what: &What) -> (String, Option<Lane>) {
    match what {
        What::Task(task) => (task.name.clone(), Some(task.lane)),
        What::Wait(wait) => (wait.name().to_owned(), None),
    }
}

fn path_shares(frames: &[Frame], paths: &[Vec<Stretch<'_>>]) -> Vec<PathShare> {
    let total_us = frames.iter().map(|f| f.time.length_us()).sum();
    let mut times_us: BTreeMap<(String, Option<Lane>, u32), f64> = BTreeMap::new();
    for stretch in paths.iter().flatten() {
        let (what, lane) = name(&stretch.what);
        *times_us.entry((what, lane, stretch.pid)).or_default() += stretch.end_us - stretch.begin_us;
    }
    let shares = times_us.into_iter().map(|((what, lane, pid), us)| {
        let ms_per_frame = us / 1000.0 / frames.len() as f64;
        PathShare { what, lane, pid, ms_per_frame, share: share(us, total_us) }
    });
    let mut shares: Vec<_> = shares.collect();
    shares.sort_by(|a, b| b.ms_per_frame.total_cmp(&a.ms_per_frame));
    shares
}

/// Intervals in which a device was busy and in which it transferred.
struct Lanes<'a> {
    pid: u32,
    device: &'a Device,
    busy: Vec<Interval>,
    transfer: Vec<Interval>,
    /// Time covered by the frames that the device took part in, microseconds.
    total_us: f64,
}

/// Returns the lanes of the devices that took part in any of the frames.
fn lanes<'a>(trace: &'a Trace, frames: &[Frame]) -> Vec<Lanes<'a>> {
    let mut by_pid: BTreeMap<u32, [Vec<Interval>; 2]> = BTreeMap::new();
    for task in frames.iter().flat_map(|frame| &frame.tasks) {
        let lanes = by_pid.entry(task.pid).or_default();
        lanes[usize::from(task.lane.is_transfer())].push((task.begin_us, task.end_us));
    }
    let devices = trace.devices.iter().filter_map(|(&pid, device)| {
        let shared: Vec<_> = frames.iter().filter(|frame| frame.time.is_shared_by(pid)).collect();
        let total_us = time_of(shared.iter().copied());
        let [busy, transfer] = by_pid.remove(&pid).unwrap_or_default().map(union);
        (!shared.is_empty()).then_some(Lanes { pid, device, busy, transfer, total_us })
    });
    devices.collect()
}

impl Lanes<'_> {
    fn sum_up(&self) -> DeviceSummary {
        let (busy_us, transfer_us) = (length(&self.busy), length(&self.transfer));
        let hidden_us = shared_length(&self.busy, &self.transfer);
        let in_use_us = busy_us + transfer_us - hidden_us;
        DeviceSummary {
            pid: self.pid,
            name: self.device.name.clone(),
            busy_ms: busy_us / 1000.0,
            transfer_ms: transfer_us / 1000.0,
            hidden_transfer_ms: hidden_us / 1000.0,
            idle_ms: (self.total_us - in_use_us).max(0.0) / 1000.0,
            busy_share: share(busy_us, self.total_us),
            clock_residual_us: self.device.clock_residual_us,
        }
    }
}
