//! Recorded work of a run as plain data, in the same form whether just recorded or read back from a file. Times are
//! microseconds.

use std::collections::BTreeMap;
use std::ops::Range;

use super::deadline::DisplayedFrame;
use super::intervals::Interval;
use super::rank_transfers::RankTransfer;
use super::{FIRST_DEVICE_PID, Lane};

/// A task of a device.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// Process of the device.
    pub pid: u32,
    pub lane: Lane,
    /// Name of the stage or of the transferred image.
    pub name: String,
    pub begin_us: f64,
    pub end_us: f64,
    pub frame: Option<u64>,
    pub rows: Option<Range<u64>>,
    /// Number of the transfer within its frame, which its download and its upload share.
    pub transfer: Option<u64>,
    pub bytes: Option<u64>,
    /// Duration that the cost model predicted, if it had learned from frames.
    pub predicted_us: Option<f64>,
    /// Number of submissions that the task was split over, if recorded.
    pub submissions: Option<u64>,
    /// Position in the graph of its frame; files of earlier versions lack it.
    pub order: Option<Order>,
}

/// Position of a task in the graph of its frame: the task's number, and its dependencies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Order {
    /// Position among the tasks of its device, in the order of execution.
    pub number: u64,
    /// The tasks that it depends on, by device process and number.
    pub after: Vec<(u32, u64)>,
}

/// Time of a frame, from planning to its images on the primary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTime {
    pub frame: u64,
    pub begin_us: f64,
    pub end_us: f64,
    /// Bit mask of the devices that rendered the frame; none if unknown.
    pub devices: Option<u64>,
}

impl FrameTime {
    pub fn length_us(&self) -> f64 {
        self.end_us - self.begin_us
    }

    pub fn is_shared_by(&self, pid: u32) -> bool {
        self.devices.is_none_or(|devices| devices.checked_shr(pid - FIRST_DEVICE_PID).is_some_and(|d| d & 1 == 1))
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Device {
    pub name: String,
    /// Error bound of the device's times, converted to the host's clock.
    pub clock_residual_us: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Devices by pid, including idle ones.
    pub devices: BTreeMap<u32, Device>,
    /// Tasks in order of begin.
    pub tasks: Vec<Task>,
    /// Times of the frames; frames whose times are not recorded are missing.
    pub frame_times: Vec<FrameTime>,
    /// Frames on a display, in order of their starts.
    pub deadlines: Vec<DisplayedFrame>,
    /// Transfers of rows from rank to rank.
    pub passages: Vec<RankTransfer>,
    /// Anomalies of the trace that are not errors, each reported once.
    pub warnings: Vec<String>,
}

/// A frame with its tasks, sorted by begin time.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    pub time: FrameTime,
    pub tasks: Vec<&'a Task>,
}

impl Trace {
    /// Returns the frames in order of their number. If the trace does not record the time of a frame, it lasts from the
    /// begin of its first task to the end of its last task.
    pub fn frames(&self) -> Vec<Frame<'_>> {
        let mut by_number: BTreeMap<u64, Vec<&Task>> = BTreeMap::new();
        for task in &self.tasks {
            if let Some(frame) = task.frame {
                by_number.entry(frame).or_default().push(task);
            }
        }
        let said: BTreeMap<u64, FrameTime> = self.frame_times.iter().map(|time| (time.frame, *time)).collect();
        let frames = by_number.into_iter().filter_map(|(frame, tasks)| {
            let (begin_us, end_us) = extent(tasks.iter().copied())?;
            let time = said.get(&frame).copied().unwrap_or(FrameTime { frame, begin_us, end_us, devices: None });
            Some(Frame { time, tasks })
        });
        frames.collect()
    }
}

/// Returns the first begin time and the last end time of tasks; `None` without tasks.
pub fn extent<'a>(tasks: impl IntoIterator<Item = &'a Task>) -> Option<Interval> {
    tasks.into_iter().map(|task| (task.begin_us, task.end_us)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}
