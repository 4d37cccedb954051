//! Reports how frame times scale with the number of devices.

pub mod chart;
mod limits;

use serde::Serialize;

use super::csv::{Column, Csv, number, optional};
use super::frame_row::aov_ms;
use super::statistics::{interquartile_range, interval_of_median};
use super::{Table, imbalance, median_of, percent};
use diptych::exec::{FrameReport, TimedTask};
use limits::{Causes, Losses, Times};

/// One row of `scale.csv`, for one device count. Values over frames are medians, and makespans exclude auxiliary
/// images.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ScaleRow {
    pub devices: usize,
    /// Name of the policy that distributed the rows.
    pub policy: String,
    /// Threads of each software device, if all have the same number.
    pub threads_per_device: Option<usize>,
    /// Number of timed frames that count, one of each turn.
    pub frames: usize,
    pub makespan_ms: f64,
    pub makespan_ms_min: f64,
    pub makespan_ms_max: f64,
    /// Interquartile range of the makespans.
    pub makespan_ms_iqr: f64,
    /// Time from the end of a frame to the end of the next one.
    pub interval_ms: f64,
    /// Median period, that is, the time per frame that determines throughput: the interval if several frames are in
    /// flight, else the makespan. `period_spread` is the interquartile range of the periods divided by their median.
    pub period_ms: f64,
    pub period_spread: f64,
    /// Number of periods over which `period_ms` is the median.
    pub periods: usize,
    /// Number of devices of the row that speedups are relative to (the base).
    pub base_devices: usize,
    /// Speedup over the base, for the same number of pixels.
    pub speedup: f64,
    /// Standard error of the speedup, from the scatter of periods in this row and in the base.
    pub speedup_error: f64,
    /// Speedup divided by the ratio of device counts, this row's over the base's.
    pub efficiency: f64,
    /// Busy time of the busiest device divided by the mean busy time of all devices.
    pub imbalance: f64,
    /// Host time in transfers, as a fraction of `period_ms` times the number of devices.
    pub transfer_share: f64,
    /// True if there are more worker threads than cores.
    pub oversubscribed: bool,
    /// Fraction of `period_ms` in which a device's queue ran no stage, mean over devices.
    pub idle_share: f64,
    /// Bytes sent between devices.
    pub bytes_per_frame: f64,
    /// Absolute difference between the predicted and the measured makespan, divided by the measured one. `None` before
    /// the cost model has learned.
    pub prediction_error: Option<f64>,
    /// Parts of the critical path, as fractions of the frames' time.
    pub critical_path: String,
    /// Ends of the 95 % interval of the makespan. All intervals are over turns; fewer than six have none.
    pub makespan_ms_low: Option<f64>,
    pub makespan_ms_high: Option<f64>,
    /// Ends of the 95 % interval of the speedup.
    pub speedup_low: Option<f64>,
    pub speedup_high: Option<f64>,
    /// Fraction of the cores that other programs took in the turns that count; `None` if it is not known.
    pub others_share: Option<f64>,
    /// Number of pixels over that of the base: 1, or the number of devices over the base's in weak scaling.
    pub work: f64,
    /// Largest loss of speedup, or `work` if losses are negligible. `None` for the base.
    pub limit: Option<&'static str>,
    /// Devices' time by cause, as fractions of `period_ms` times the number of devices.
    #[serde(flatten)]
    pub losses: Losses,
    /// Period of each turn.
    #[serde(skip)]
    pub turns_ms: Vec<f64>,
    #[serde(skip)]
    causes: Causes,
}

impl ScaleRow {
    /// Summarises the timed frames of turns, without a comparison with the base. They have `work` times as many pixels
    /// as those of the base.
    pub fn new(devices: usize, work: f64, frames: &[FrameReport]) -> Self {
        let values = |of: &dyn Fn(&FrameReport) -> f64| frames.iter().map(of).collect::<Vec<_>>();
        let median = |of: &dyn Fn(&FrameReport) -> f64| median_of(values(of));
        let makespan_ms = |f: &FrameReport| f.makespan_ms - aov_ms(&f.tasks);
        let makespans_ms = values(&makespan_ms);
        let intervals_ms = values(&|f| f.interval_ms.unwrap_or(f.makespan_ms));
        let overlapped = frames.iter().any(|f| f.overlapped);
        let periods_ms = if overlapped { intervals_ms.clone() } else { makespans_ms.clone() };
        let period_ms = median_of(periods_ms.clone());
        let idle = |f: &FrameReport| 1.0 - f.busy_ms().iter().sum::<f64>() / (period_ms * devices as f64);
        let error = |f: &FrameReport| Some((f.predicted_ms? - f.makespan_ms).abs() / makespan_ms(f));
        let errors: Vec<f64> = frames.iter().filter_map(error).collect();
        let [makespan_ms_low, makespan_ms_high] = ends(interval_of_median(&makespans_ms));
        let causes = Causes::of(frames);
        Self {
            devices,
            work,
            frames: frames.len(),
            makespan_ms: median_of(makespans_ms.clone()),
            makespan_ms_min: makespans_ms.iter().copied().fold(f64::INFINITY, f64::min),
            makespan_ms_max: makespans_ms.iter().copied().fold(0.0, f64::max),
            makespan_ms_iqr: interquartile_range(makespans_ms),
            makespan_ms_low,
            makespan_ms_high,
            interval_ms: median_of(intervals_ms),
            period_ms,
            periods: periods_ms.len(),
            period_spread: interquartile_range(periods_ms.clone()) / period_ms,
            imbalance: median(&|f| imbalance(&f.busy_ms())),
            transfer_share: median(&|f| transfer_ms(f) / (period_ms * devices as f64)),
            idle_share: median(&idle),
            bytes_per_frame: median(&|f| f.uploaded_bytes() as f64),
            prediction_error: super::median(errors),
            critical_path: causes.path_text(),
            causes,
            turns_ms: periods_ms,
            ..Self::default()
        }
    }

    /// Compares a row with the base; `None` makes it the base.
    #[must_use]
    pub fn over(self, base: Option<&ScaleRow>) -> Self {
        let Some(base) = base else {
            let losses = Losses::of(&self.times(), &self.times());
            return Self { base_devices: self.devices, speedup: 1.0, efficiency: 1.0, losses, ..self };
        };
        let speedup = self.work * base.period_ms / self.period_ms;
        let efficiency = speedup * base.devices as f64 / self.devices as f64;
        let speedup_error = speedup * base.relative_error().hypot(self.relative_error());
        // Frames of a turn have the same load beside them.
        let turns = base.turns_ms.iter().zip(&self.turns_ms);
        let of_turns: Vec<f64> = turns.map(|(base, own)| self.work * base / own).collect();
        // The median of ratios may differ from the ratio of medians.
        let interval = interval_of_median(&of_turns).map(|[low, high]| [low.min(speedup), high.max(speedup)]);
        let [speedup_low, speedup_high] = ends(interval);
        let losses = Losses::of(&self.times(), &base.times());
        let limit = Some(losses.limit(self.oversubscribed || self.threads_per_device.is_some()));
        let row = Self { base_devices: base.devices, speedup, speedup_error, efficiency, ..self };
        Self { speedup_low, speedup_high, losses, limit, ..row }
    }

    fn times(&self) -> Times<'_> {
        let &Self { devices, work, period_ms, idle_share, imbalance, ref causes, .. } = self;
        Times { devices, work, period_ms, idle_share, imbalance, causes }
    }

    /// Returns a warning if the devices seem to do more than they can.
    pub fn warning(&self) -> Option<String> {
        let Self { devices, efficiency, .. } = self;
        let what = "the base was disturbed, or the work of one device does not fit its caches";
        (*efficiency > MOST_EFFICIENCY)
            .then(|| format!("the efficiency of {devices} devices is {efficiency:.2}, above 1: {what}"))
    }

    fn note(&self) -> &'static str {
        match (self.devices == self.base_devices, self.oversubscribed) {
            (true, false) => "base",
            (true, true) => "base, oversubscribed",
            (false, true) => "oversubscribed",
            (false, false) => "",
        }
    }

    /// Returns the relative standard error of the median, for roughly normally distributed periods: 1.25 IQR / (1.35
    /// √n) (McGill, Tukey & Larsen, "Variations of Box Plots", 1978).
    fn relative_error(&self) -> f64 {
        1.25 / 1.35 * self.period_spread / (self.periods as f64).sqrt()
    }
}

fn transfer_ms(frame: &FrameReport) -> f64 {
    let transfers = frame.tasks.iter().filter(|t| !matches!(t.kind, TimedTask::Gpu(_)));
    transfers.map(|t| t.end_ms - t.begin_ms).fold(0.0, |sum, ms| sum + ms)
}

fn ends(interval: Option<[f64; 2]>) -> [Option<f64>; 2] {
    [interval.map(|ends| ends[0]), interval.map(|ends| ends[1])]
}

/// Largest efficiency that scatter explains.
const MOST_EFFICIENCY: f64 = 1.02;

const COLUMNS: [Column<ScaleRow>; 33] = [
    ("devices", |r| r.devices.to_string()),
    ("makespan_ms", |r| format!("{:.4}", r.makespan_ms)),
    ("makespan_ms_min", |r| format!("{:.4}", r.makespan_ms_min)),
    ("makespan_ms_max", |r| format!("{:.4}", r.makespan_ms_max)),
    ("speedup", |r| format!("{:.4}", r.speedup)),
    ("efficiency", |r| format!("{:.4}", r.efficiency)),
    ("imbalance", |r| format!("{:.4}", r.imbalance)),
    ("transfer_share", |r| format!("{:.5}", r.transfer_share)),
    ("oversubscribed", |r| r.oversubscribed.to_string()),
    ("base_devices", |r| r.base_devices.to_string()),
    ("frames", |r| r.frames.to_string()),
    ("idle_share", |r| format!("{:.5}", r.idle_share)),
    ("makespan_ms_iqr", |r| format!("{:.4}", r.makespan_ms_iqr)),
    ("interval_ms", |r| format!("{:.4}", r.interval_ms)),
    ("period_spread", |r| format!("{:.5}", r.period_spread)),
    ("speedup_error", |r| format!("{:.5}", r.speedup_error)),
    ("bytes_per_frame", |r| format!("{:.0}", r.bytes_per_frame)),
    ("prediction_error", |r| number(r.prediction_error, 5)),
    ("policy", |r| r.policy.clone()),
    ("threads_per_device", |r| optional(r.threads_per_device)),
    ("makespan_ms_low", |r| number(r.makespan_ms_low, 4)),
    ("makespan_ms_high", |r| number(r.makespan_ms_high, 4)),
    ("speedup_low", |r| number(r.speedup_low, 4)),
    ("speedup_high", |r| number(r.speedup_high, 4)),
    ("others_share", |r| number(r.others_share, 4)),
    ("work", |r| format!("{:.4}", r.work)),
    ("limit", |r| r.limit.unwrap_or_default().to_owned()),
    ("lost_slower", |r| format!("{:.4}", r.losses.lost_slower)),
    ("lost_redundant", |r| format!("{:.4}", r.losses.lost_redundant)),
    ("lost_imbalance", |r| format!("{:.4}", r.losses.lost_imbalance)),
    ("lost_transfers", |r| format!("{:.4}", r.losses.lost_transfers)),
    ("lost_serial", |r| format!("{:.4}", r.losses.lost_serial)),
    ("lost_waits", |r| format!("{:.4}", r.losses.lost_waits)),
];

/// Returns the contents of `scale.csv`.
pub fn scale_csv(rows: &[ScaleRow]) -> Csv {
    Csv::new(&COLUMNS, rows)
}

const SHOWN: [Column<ScaleRow>; 13] = [
    ("devices", |r| r.devices.to_string()),
    ("makespan ms", |r| format!("{:.1}{}", r.makespan_ms, range([r.makespan_ms_low, r.makespan_ms_high], 1))),
    ("a frame every", |r| format!("{:.1}", r.interval_ms)),
    ("spread", |r| percent(r.period_spread)),
    ("speed-up", |r| format!("{:.2}{}", r.speedup, range([r.speedup_low, r.speedup_high], 2))),
    ("efficiency", |r| format!("{:.2}", r.efficiency)),
    ("imbalance", |r| format!("{:.3}", r.imbalance)),
    ("transfers", |r| percent(r.transfer_share)),
    ("idle", |r| percent(r.idle_share)),
    ("MB moved", |r| format!("{:.2}", r.bytes_per_frame / 1e6)),
    ("predicted off by", |r| r.prediction_error.map_or("-".into(), percent)),
    ("limited by", |r| r.limit.unwrap_or("-").to_owned()),
    ("note", |r| r.note().to_owned()),
];

/// Formats an interval; nothing if there is none.
fn range(ends: [Option<f64>; 2], decimals: usize) -> String {
    let [Some(low), Some(high)] = ends else { return String::new() };
    format!(" ({low:.decimals$} to {high:.decimals$})")
}

pub fn scale_table(rows: &[ScaleRow]) -> Table {
    Table::new(&SHOWN, rows).with_policies(rows.iter().map(|r| r.policy.as_str()))
}

#[cfg(test)]
mod tests;
