//! Reports how frame times scale with the number of devices: rows, CSV, tables, a plot of speedup, and page sections.

use serde::Serialize;

use super::csv::{Column, Csv, number, optional};
use super::frame_row::aov_ms;
use super::html::Section;
use super::plot::{Chart, Series, line_chart_svg};
use super::study::quartiles;
use super::{ReportError, Table, imbalance, median_of, once, percent, shares_text};
use diptych::exec::{FrameReport, TimedTask};
use diptych::schedule::LOSS_SHARE;
use diptych::trace::frames::trace_from;
use diptych::trace::summary::Summary;

/// One row of `scale.csv`, for one device count. Values over frames are medians, and makespans exclude auxiliary
/// images.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ScaleRow {
    pub devices: usize,
    /// Name of the policy that distributed the rows.
    pub policy: String,
    /// Threads of each software device, if all have the same number.
    pub threads_per_device: Option<usize>,
    /// Number of timed frames.
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
    /// Speedup over the base.
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
}

impl ScaleRow {
    /// Summarises timed frames. `base` is the row that defines a speedup of 1, and `None` for that row itself.
    pub fn new(devices: usize, frames: &[FrameReport], oversubscribed: bool, base: Option<&ScaleRow>) -> Self {
        let values = |of: &dyn Fn(&FrameReport) -> f64| frames.iter().map(of).collect::<Vec<_>>();
        let median = |of: &dyn Fn(&FrameReport) -> f64| median_of(values(of));
        let makespan_ms = |f: &FrameReport| f.makespan_ms - aov_ms(&f.tasks);
        let makespans_ms = values(&makespan_ms);
        // The first timed frame may have begun before the others were in flight.
        let intervals_ms: Vec<f64> = frames.iter().skip(1).filter_map(|f| f.interval_ms).collect();
        let overlapped = frames.iter().any(|f| f.overlapped);
        let periods_ms = if overlapped { intervals_ms.clone() } else { makespans_ms.clone() };
        let period_ms = median_of(periods_ms.clone());
        let idle = |f: &FrameReport| 1.0 - f.busy_ms().iter().sum::<f64>() / (period_ms * devices as f64);
        let error = |f: &FrameReport| Some((f.predicted_ms? - f.makespan_ms).abs() / makespan_ms(f));
        let errors: Vec<f64> = frames.iter().filter_map(error).collect();
        let row = Self {
            devices,
            frames: frames.len(),
            makespan_ms: median_of(makespans_ms.clone()),
            makespan_ms_min: makespans_ms.iter().copied().fold(f64::INFINITY, f64::min),
            makespan_ms_max: makespans_ms.iter().copied().fold(0.0, f64::max),
            makespan_ms_iqr: interquartile_range(makespans_ms),
            interval_ms: median_of(intervals_ms),
            period_ms,
            periods: periods_ms.len(),
            period_spread: interquartile_range(periods_ms) / period_ms,
            imbalance: median(&|f| imbalance(&f.busy_ms())),
            transfer_share: median(&|f| transfer_ms(f) / (period_ms * devices as f64)),
            oversubscribed,
            idle_share: median(&idle),
            bytes_per_frame: median(&|f| f.uploaded_bytes() as f64),
            prediction_error: super::median(errors),
            critical_path: critical_path(frames),
            ..Self::default()
        };
        row.over(base)
    }

    fn over(self, base: Option<&ScaleRow>) -> Self {
        let Some(base) = base else {
            return Self { base_devices: self.devices, speedup: 1.0, efficiency: 1.0, ..self };
        };
        let speedup = base.period_ms / self.period_ms;
        let efficiency = speedup * base.devices as f64 / self.devices as f64;
        let speedup_error = speedup * base.relative_error().hypot(self.relative_error());
        Self { base_devices: base.devices, speedup, speedup_error, efficiency, ..self }
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

    /// Splits the devices' time by cause. The fractions add up to 1.
    fn shares(&self, first: &ScaleRow) -> Shares {
        let busy = 1.0 - self.idle_share;
        let busy_ms = |r: &ScaleRow| r.period_ms * (1.0 - r.idle_share) * r.devices as f64;
        let work = busy * busy_ms(first) / busy_ms(self);
        let uneven = (self.imbalance - 1.0) * busy;
        Shares { work, more: busy - work, uneven, waits: self.idle_share - uneven }
    }
}

struct Shares {
    /// Fraction of the devices' time spent on work that the first row's devices had as well.
    work: f64,
    /// Fraction of the devices' time spent in stages in addition to `work`, because of margins, slower devices, or
    /// shared caches and cores.
    more: f64,
    /// Load imbalance: idle time of devices that have less work than the busiest one.
    uneven: f64,
    /// Time in which even the busiest device was idle: transfers, gaps between stages, the host.
    waits: f64,
}

impl Shares {
    /// Returns the name of the largest loss, or `work` if losses are negligible.
    fn limit(&self) -> &'static str {
        let losses = [("more work", self.more), ("uneven stripes", self.uneven), ("waits", self.waits)];
        let lost: f64 = losses.iter().map(|(_, share)| share).sum();
        let largest = losses.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        largest.filter(|_| lost > LOSS_SHARE).map_or("work", |(name, _)| name)
    }
}

fn transfer_ms(frame: &FrameReport) -> f64 {
    let transfers = frame.tasks.iter().filter(|t| !matches!(t.kind, TimedTask::Gpu(_)));
    transfers.map(|t| t.end_ms - t.begin_ms).fold(0.0, |sum, ms| sum + ms)
}

fn critical_path(frames: &[FrameReport]) -> String {
    let summary = Summary::of(&trace_from(frames));
    let parts = summary.critical_path.iter().map(|part| match part.lane {
        None => ("waits", part.share),
        Some(lane) if lane.is_transfer() => ("transfers", part.share),
        Some(_) => (part.what.as_str(), part.share),
    });
    shares_text(parts)
}

/// Returns the interquartile range, interpolated linearly (type 7 of Hyndman & Fan, "Sample Quantiles", 1996).
fn interquartile_range(values: Vec<f64>) -> f64 {
    let [lower, _, upper] = quartiles(values);
    upper - lower
}

const COLUMNS: [Column<ScaleRow>; 20] = [
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
];

/// Returns the contents of `scale.csv`.
pub fn scale_csv(rows: &[ScaleRow]) -> Csv {
    Csv::new(&COLUMNS, rows)
}

const SHOWN: [Column<ScaleRow>; 13] = [
    ("devices", |r| r.devices.to_string()),
    ("makespan ms", |r| format!("{:.1}", r.makespan_ms)),
    ("min..max", |r| format!("{:.1}..{:.1}", r.makespan_ms_min, r.makespan_ms_max)),
    ("a frame every", |r| format!("{:.1}", r.interval_ms)),
    ("spread", |r| percent(r.period_spread)),
    ("speed-up", |r| format!("{:.2} ± {:.2}", r.speedup, r.speedup_error)),
    ("efficiency", |r| format!("{:.2}", r.efficiency)),
    ("imbalance", |r| format!("{:.3}", r.imbalance)),
    ("transfers", |r| percent(r.transfer_share)),
    ("idle", |r| percent(r.idle_share)),
    ("MB moved", |r| format!("{:.2}", r.bytes_per_frame / 1e6)),
    ("predicted off by", |r| r.prediction_error.map_or("-".into(), percent)),
    ("note", |r| r.note().to_owned()),
];

pub fn scale_table(rows: &[ScaleRow]) -> Table {
    Table::new(&SHOWN, rows).with_policies(rows.iter().map(|r| r.policy.as_str()))
}

/// A row, with its devices' time by cause.
type Limited<'a> = (&'a ScaleRow, Shares);

/// Returns a table that shows, for each device count, what limits the speedup.
fn limits_table(rows: &[ScaleRow]) -> Table {
    let columns: [Column<Limited>; 7] = [
        ("devices", |(row, _)| row.devices.to_string()),
        ("work", |(_, shares)| percent(shares.work)),
        ("more work", |(_, shares)| percent(shares.more)),
        ("uneven stripes", |(_, shares)| percent(shares.uneven)),
        ("waits", |(_, shares)| percent(shares.waits)),
        ("limited by", |(_, shares)| shares.limit().to_owned()),
        ("critical path, of the frames' time", |(row, _)| row.critical_path.clone()),
    ];
    let limited: Vec<Limited> = rows.iter().map(|row| (row, row.shares(&rows[0]))).collect();
    Table::new(&columns, &limited).with_policies(rows.iter().map(|r| r.policy.as_str()))
}

/// Plots speedup over device counts with a band for its standard error, beside the ideal.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn scale_svg(title: String, rows: &[ScaleRow]) -> Result<String, ReportError> {
    let first = rows.first().map_or(1.0, |r| r.devices as f64);
    let guide = rows.iter().map(|r| (r.devices as f64, r.devices as f64 / first)).collect();
    let mut series = vec![Series { name: "ideal".into(), points: guide, band: None, guide: true }];
    let policies = once(rows.iter().map(|r| r.policy.as_str()));
    for policy in &policies {
        // The line of every policy starts at the base, which is the first row.
        let own = || rows.iter().enumerate().filter(|(i, r)| *i == 0 || r.policy == *policy).map(|(_, row)| row);
        let name = if policies.len() > 1 { (*policy).to_owned() } else { "measured".to_owned() };
        let points = own().map(|r| (r.devices as f64, r.speedup)).collect();
        let band = own().map(|r| (r.speedup - r.speedup_error, r.speedup + r.speedup_error)).collect();
        series.push(Series { name, points, band: Some(band), guide: false });
    }
    line_chart_svg(&Chart::new(title, ["devices", "speed-up"], false), &series)
}

/// Returns the sections of a page on scaling and its limits; `figure` is the plot.
pub fn scale_sections(rows: &[ScaleRow], figure: String) -> [Section; 2] {
    let scaling = "Makespan: median latency of a frame, from its plan until both images are on the primary. A frame \
        every: median interval between the ends of consecutive frames. The period is the makespan or, with several \
        frames in flight, that interval. Spread: interquartile range of the periods over their median. Speed-up: the \
        first row's period over this row's, with its standard error from the scatter of both. Imbalance: busy time of \
        the busiest device over the mean. Transfers: host time spent in transfers; idle: time in which a queue ran no \
        stage; both as fractions of period times devices. Predicted off by: median error of the cost model's predicted \
        makespan, relative to the measured one.";
    let oversubscribed = "Oversubscribed: the devices together have more threads than there are cores, so they take \
        time from one another. Their speed-up says nothing about separate devices.";
    let limits = "Fractions of the devices' time (period times devices) by cause. Work: time in stages that the first \
        row's devices needed as well; ideally, all time is work. More work: additional time in stages, for example for \
        margins that two devices compute, or because devices share caches and cores. Uneven stripes: idle time of \
        devices with less work than the busiest one. Waits: time in which even the busiest device is idle, because of \
        transfers, gaps between stages or the host.";
    let mut notes = vec![scaling.to_owned()];
    notes.extend(rows.iter().any(|r| r.oversubscribed).then(|| oversubscribed.to_owned()));
    [
        Section { heading: "Scaling", notes, table: Some(scale_table(rows)), figure: Some(figure) },
        Section {
            heading: "What limits each count",
            notes: vec![limits.to_owned()],
            table: Some(limits_table(rows)),
            figure: None,
        },
    ]
}

#[cfg(test)]
mod tests;
