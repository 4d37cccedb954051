//! A trace summed up: how busy each device was, how well they worked side by side, and how long frames took.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::TraceError;
use super::intervals::{Interval, length, length_in_two_or_more, shared_length, union};
use super::read::{self, Task, Trace};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceSummary {
    pub pid: u32,
    pub name: String,
    /// Some work on an eye or both ran.
    pub busy_ms: f64,
    /// Some upload or download ran.
    pub transfer_ms: f64,
    /// Part of `transfer_ms` in which the device was busy as well.
    pub hidden_transfer_ms: f64,
    /// Rest of the makespan: neither busy nor transferring.
    pub idle_ms: f64,
    /// `busy_ms` over the makespan of the whole trace.
    pub busy_share: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameSummary {
    pub frame: u64,
    /// After the trace's first device task.
    pub begin_ms: f64,
    /// From the frame's first begin to its last end on any device.
    pub makespan_ms: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    pub devices: Vec<DeviceSummary>,
    /// Of tasks that say their frame.
    pub frames: Vec<FrameSummary>,
    /// From the first begin to the last end on any device.
    pub makespan_ms: f64,
    /// Time in which at least two devices were busy, over the makespan.
    pub overlap_share: f64,
    /// Share of transfer time in which the transferring device was busy as well; none without transfers.
    pub hidden_transfer_share: Option<f64>,
    /// Largest over mean busy time of the devices, 1 is even; none when nothing was busy.
    pub imbalance: Option<f64>,
    pub warnings: Vec<String>,
}

impl Summary {
    /// Reads, checks and sums up the trace at `path`.
    ///
    /// # Errors
    /// Those of [`read::read`].
    pub fn read(path: &Path) -> Result<Summary, TraceError> {
        read::read(path).map(|trace| Summary::of(&trace))
    }

    pub fn of(trace: &Trace) -> Summary {
        let all = span_of(&trace.tasks);
        let makespan_us = all.map_or(0.0, |(begin, end)| end - begin);
        let share = |us: f64| {
            if makespan_us > 0.0 { us / makespan_us } else { 0.0 }
        };
        let lanes: Vec<Lanes> = trace.devices.iter().map(|(&pid, name)| Lanes::of(trace, pid, name)).collect();
        let busy_us: Vec<f64> = lanes.iter().map(|device| length(&device.busy)).collect();
        let (total_us, most_us) = busy_us.iter().fold((0.0, 0.0f64), |(sum, max), &us| (sum + us, max.max(us)));
        let devices: Vec<_> = lanes.iter().map(|device| device.sum_up(makespan_us)).collect();
        let transfer_ms: f64 = devices.iter().map(|d| d.transfer_ms).sum();
        let hidden_ms: f64 = devices.iter().map(|d| d.hidden_transfer_ms).sum();
        let mut warnings = trace.warnings.clone();
        if trace.tasks.is_empty() {
            warnings.push("there is no device work in this trace".to_owned());
        }
        Summary {
            frames: frames(&trace.tasks, all.map_or(0.0, |(begin, _)| begin)),
            makespan_ms: makespan_us / 1000.0,
            overlap_share: share(length_in_two_or_more(lanes.iter().map(|device| &device.busy))),
            hidden_transfer_share: (transfer_ms > 0.0).then(|| hidden_ms / transfer_ms),
            imbalance: (total_us > 0.0).then(|| most_us * busy_us.len() as f64 / total_us),
            devices,
            warnings,
        }
    }
}

/// First begin and last end.
fn span_of<'a>(tasks: impl IntoIterator<Item = &'a Task>) -> Option<Interval> {
    tasks.into_iter().map(|task| (task.begin_us, task.end_us)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

fn frames(tasks: &[Task], zero_us: f64) -> Vec<FrameSummary> {
    let mut by_frame: BTreeMap<u64, Vec<&Task>> = BTreeMap::new();
    for task in tasks {
        if let Some(frame) = task.frame {
            by_frame.entry(frame).or_default().push(task);
        }
    }
    let summaries = by_frame.into_iter().filter_map(|(frame, tasks)| {
        let (begin_us, end_us) = span_of(tasks)?;
        Some(FrameSummary { frame, begin_ms: (begin_us - zero_us) / 1000.0, makespan_ms: (end_us - begin_us) / 1000.0 })
    });
    summaries.collect()
}

/// When a device was busy and when it transferred.
struct Lanes<'a> {
    pid: u32,
    name: &'a str,
    busy: Vec<Interval>,
    transfer: Vec<Interval>,
}

impl Lanes<'_> {
    fn of<'a>(trace: &Trace, pid: u32, name: &'a str) -> Lanes<'a> {
        let when = |is_transfer: bool| {
            let tasks = trace.tasks.iter();
            let chosen = tasks.filter(|t| t.pid == pid && t.lane.is_transfer() == is_transfer);
            union(chosen.map(|t| (t.begin_us, t.end_us)).collect())
        };
        Lanes { pid, name, busy: when(false), transfer: when(true) }
    }

    fn sum_up(&self, makespan_us: f64) -> DeviceSummary {
        let (busy_us, transfer_us) = (length(&self.busy), length(&self.transfer));
        let hidden_us = shared_length(&self.busy, &self.transfer);
        let in_use_us = busy_us + transfer_us - hidden_us;
        DeviceSummary {
            pid: self.pid,
            name: self.name.to_owned(),
            busy_ms: busy_us / 1000.0,
            transfer_ms: transfer_us / 1000.0,
            hidden_transfer_ms: hidden_us / 1000.0,
            idle_ms: (makespan_us - in_use_us).max(0.0) / 1000.0,
            busy_share: if makespan_us > 0.0 { busy_us / makespan_us } else { 0.0 },
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.devices.iter().map(|device| device.name.chars().count());
        let width = names.max().unwrap_or(0).max("device".len());
        writeln!(f, "{:width$}  {:>12}  {:>12}  {:>12}  {:>6}", "device", "busy ms", "transfer ms", "idle ms", "busy")?;
        for device in &self.devices {
            writeln!(
                f,
                "{:width$}  {:12.3}  {:12.3}  {:12.3}  {:5.1}%",
                device.name,
                device.busy_ms,
                device.transfer_ms,
                device.idle_ms,
                device.busy_share * 100.0
            )?;
        }
        writeln!(f)?;
        writeln!(f, "makespan          {:.3} ms", self.makespan_ms)?;
        let share = self.overlap_share * 100.0;
        writeln!(f, "overlap           {share:.1}% with two or more devices busy")?;
        if let Some(share) = self.hidden_transfer_share {
            let share = share * 100.0;
            writeln!(f, "hidden transfers  {share:.1}% of transfer time")?;
        }
        if let Some(imbalance) = self.imbalance {
            writeln!(f, "imbalance         {imbalance:.3} (largest over mean busy time)")?;
        }
        self.fmt_frames(f)?;
        self.warnings.iter().try_for_each(|warning| writeln!(f, "note: {warning}"))
    }
}

impl Summary {
    fn fmt_frames(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut times: Vec<f64> = self.frames.iter().map(|frame| frame.makespan_ms).collect();
        times.sort_by(f64::total_cmp);
        let (Some(least), Some(most)) = (times.first(), times.last()) else {
            return Ok(());
        };
        let middle = times.len() / 2;
        let median = (times[middle] + times[(times.len() - 1) / 2]) / 2.0;
        let count = times.len();
        writeln!(f, "frames            {count}, makespan median {median:.3} ms, least {least:.3}, most {most:.3}")
    }
}
