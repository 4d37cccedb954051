//! What a run did, as plain data: the same whether just recorded or read back from a file. Times are microseconds.

use std::collections::BTreeMap;
use std::ops::Range;

use super::intervals::Interval;
use super::passages::Passage;
use super::{FIRST_DEVICE_PID, Lane};

/// One piece of device work.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// The device's process.
    pub pid: u32,
    pub lane: Lane,
    /// The stage, or what was transferred.
    pub name: String,
    pub begin_us: f64,
    pub end_us: f64,
    pub frame: Option<u64>,
    pub rows: Option<Range<u64>>,
    /// Number of the transfer within its frame; its download and its upload have it.
    pub transfer: Option<u64>,
    pub bytes: Option<u64>,
    /// How many submissions it was spread over, where that is said.
    pub submissions: Option<u64>,
    /// Where it is in its frame's graph; files of earlier versions do not say it.
    pub order: Option<Order>,
}

/// Where a task is in the graph of its frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Order {
    /// Among the tasks of its device, in the order in which the device carries them out.
    pub number: u64,
    /// The tasks that it depends on, by device process and number.
    pub after: Vec<(u32, u64)>,
}

/// From the plan of a frame to its images on the primary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTime {
    pub frame: u64,
    pub begin_us: f64,
    pub end_us: f64,
    /// The devices that it was shared out over, a bit each; none where that is not known.
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
    /// Bound on the error of its times against the host's.
    pub clock_residual_us: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// By pid; also devices that did nothing.
    pub devices: BTreeMap<u32, Device>,
    /// In order of begin.
    pub tasks: Vec<Task>,
    /// Frames that say when they began and ended.
    pub frame_times: Vec<FrameTime>,
    /// Of rows from rank to rank.
    pub passages: Vec<Passage>,
    /// What is odd about the trace but no error, each said once.
    pub warnings: Vec<String>,
}

/// A frame with its work, in order of begin.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    pub time: FrameTime,
    pub tasks: Vec<&'a Task>,
}

impl Trace {
    /// Frames in order of their number. One that does not say its time lasts from its first begin to its last end.
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

/// First begin and last end.
pub fn extent<'a>(tasks: impl IntoIterator<Item = &'a Task>) -> Option<Interval> {
    tasks.into_iter().map(|task| (task.begin_us, task.end_us)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}
