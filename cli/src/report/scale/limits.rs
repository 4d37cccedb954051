//! Why devices together are not as fast as their number promises: their time by cause.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::report::{median_of, shares_text};
use diptych::exec::{FrameReport, TimedTask};
use diptych::schedule::LOSS_SHARE;
use diptych::trace::frames::path;

/// Measurements of frames that tell the causes of losses.
#[derive(Clone, Debug, Default)]
pub(super) struct Causes {
    /// Rows and busy time of each stage of an eye, summed over devices and frames.
    stages: BTreeMap<(String, usize), (f64, f64)>,
    /// Median time before the first stage and after the last one of any device.
    pub serial_ms: f64,
    /// Stages, transfers and waits of the critical path, as fractions of the frames' time.
    pub path: Vec<(String, f64)>,
}

const TRANSFERS: &str = "transfers";

impl Causes {
    pub fn of(frames: &[FrameReport]) -> Self {
        let is_stage = |kind| matches!(kind, TimedTask::Gpu(_));
        let mut stages: BTreeMap<_, (f64, f64)> = BTreeMap::new();
        for task in frames.iter().flat_map(|frame| &frame.tasks).filter(|task| is_stage(task.kind)) {
            let (rows, ms) = stages.entry((task.stage.to_string(), task.view.index())).or_default();
            *rows += f64::from(task.rows.end - task.rows.start);
            *ms += task.end_ms - task.begin_ms;
        }
        let serial_ms = |frame: &FrameReport| {
            let own = || frame.tasks.iter().filter(|task| is_stage(task.kind));
            let begin_ms = own().map(|task| task.begin_ms).reduce(f64::min)?;
            let end_ms = own().map(|task| task.end_ms).reduce(f64::max)?;
            Some(frame.makespan_ms - (end_ms - begin_ms))
        };
        let all_ms: f64 = frames.iter().map(|frame| frame.makespan_ms).sum();
        let steps = frames.iter().flat_map(|frame| path(&frame.tasks, frame.begin_ms, frame.makespan_ms));
        let parts = steps.map(|step| match step.lane {
            None => ("waits".to_owned(), step.time_ms / all_ms),
            Some(lane) if lane.is_transfer() => (TRANSFERS.to_owned(), step.time_ms / all_ms),
            Some(_) => (step.what, step.time_ms / all_ms),
        });
        Self { stages, serial_ms: median_of(frames.iter().filter_map(serial_ms).collect()), path: parts.collect() }
    }

    /// Describes the critical path.
    pub fn path_text(&self) -> String {
        shares_text(self.path.iter().map(|(what, share)| (what.as_str(), *share)))
    }

    /// Returns the time of rows that several devices compute, as a fraction of the time of all rows. The base computes
    /// each row once. Both have the same number of frames. Images are `taller` than those of the base by this factor.
    fn redundant(&self, base: &Self, taller: f64) -> f64 {
        let (mut redundant_ms, mut all_ms) = (0.0, 0.0);
        for (stage, (rows, ms)) in &self.stages {
            let rows_of_base = base.stages.get(stage).map_or(*rows, |(rows, _)| *rows);
            redundant_ms += ms * (1.0 - taller * rows_of_base / rows.max(1.0)).max(0.0);
            all_ms += ms;
        }
        if all_ms > 0.0 { redundant_ms / all_ms } else { 0.0 }
    }
}

/// Losses of devices compared with the base, by cause, as fractions of the devices' time (period times devices). The
/// rest of the time is work that the base does as well.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Losses {
    /// Additional time of stages for the same rows: devices share cores, caches or an adapter, or are slower.
    pub lost_slower: f64,
    /// Rows that several devices compute, such as margins. They take a larger part of the time the fewer rows a device
    /// has.
    pub lost_redundant: f64,
    /// Idle time of devices that have less work than the busiest one.
    pub lost_imbalance: f64,
    /// Time of transfers in which even the busiest device is idle.
    pub lost_transfers: f64,
    /// Time before the first stage and after the last one, in which no device runs a stage.
    pub lost_serial: f64,
    /// Other time in which even the busiest device is idle: gaps between stages, waits for other devices.
    pub lost_waits: f64,
}

/// Times of a number of devices from which losses follow; the fields are those of `ScaleRow`.
pub(super) struct Times<'a> {
    pub devices: usize,
    pub work: f64,
    pub period_ms: f64,
    pub idle_share: f64,
    pub imbalance: f64,
    pub causes: &'a Causes,
}

impl Losses {
    /// Splits the time of devices.
    pub(super) fn of(row: &Times<'_>, base: &Times<'_>) -> Self {
        let busy = 1.0 - row.idle_share;
        let busy_ms = |r: &Times<'_>| r.period_ms * (1.0 - r.idle_share) * r.devices as f64;
        let more = busy - busy * row.work * busy_ms(base) / busy_ms(row);
        let lost_redundant = (busy * row.causes.redundant(base.causes, row.work.sqrt())).min(more.max(0.0));
        let lost_imbalance = (row.imbalance - 1.0) * busy;
        let idle = row.idle_share - lost_imbalance;
        let lost_serial = (row.causes.serial_ms / row.period_ms).min(idle.max(0.0));
        let shares = row.causes.path.iter().filter(|(what, _)| what == TRANSFERS).map(|(_, share)| share);
        let in_transfers = shares.fold(0.0, |sum, share| sum + share);
        let lost_transfers = in_transfers.min((idle - lost_serial).max(0.0));
        Self {
            lost_slower: more - lost_redundant,
            lost_redundant,
            lost_imbalance,
            lost_transfers,
            lost_serial,
            lost_waits: idle - lost_serial - lost_transfers,
        }
    }

    pub fn all(&self) -> f64 {
        self.lost_slower
            + self.lost_redundant
            + self.lost_imbalance
            + self.lost_transfers
            + self.lost_serial
            + self.lost_waits
    }

    /// Returns the name of the largest loss, or `work` if losses are negligible. Devices that run on `cores` are slower
    /// beside others because they share them.
    pub fn limit(&self, on_cores: bool) -> &'static str {
        let losses = [
            (if on_cores { "cores" } else { "slower stages" }, self.lost_slower),
            ("too few rows", self.lost_redundant),
            ("imbalance", self.lost_imbalance),
            (TRANSFERS, self.lost_transfers),
            ("serial part", self.lost_serial),
            ("waits", self.lost_waits),
        ];
        let largest = losses.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        largest.filter(|_| self.all() > LOSS_SHARE).map_or("work", |(name, _)| name)
    }
}
