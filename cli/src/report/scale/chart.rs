//! Chart and page sections of scaling, and the laws of Amdahl and Gustafson.

use std::fmt;

use serde::Serialize;

use super::{ScaleRow, scale_table};
use crate::report::csv::Column;
use crate::report::html::Section;
use crate::report::plot::{Axis, Chart, Series, line_chart_svg};
use crate::report::statistics::interval_of_median;
use crate::report::{ReportError, Table, once, percent};

/// A law of scaling, fitted by least squares to the periods of a policy: the part of the time that does not become
/// shorter with more devices.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Law {
    pub policy: String,
    /// `Amdahl` for equal images (Amdahl 1967, "Validity of the single processor approach"). `Gustafson` for images
    /// whose pixels grow with the devices (Gustafson 1988, "Reevaluating Amdahl's law").
    pub name: &'static str,
    pub serial_share: f64,
    /// Ends of the 95 % interval of `serial_share`, over turns; `None` for fewer than six.
    pub interval: Option<[f64; 2]>,
}

impl Law {
    /// Fits the law to the rows of each policy. The first row is the base. Devices that share cores do not count.
    pub fn of_rows(rows: &[ScaleRow]) -> Vec<Self> {
        let Some((base, rows)) = rows.split_first() else { return Vec::new() };
        let name = if rows.iter().all(|row| row.work == base.work) { "Amdahl" } else { "Gustafson" };
        let own: Vec<&ScaleRow> = rows.iter().filter(|row| !row.oversubscribed && row.devices > base.devices).collect();
        let fit = |policy: &str| {
            let own: Vec<&ScaleRow> = own.iter().copied().filter(|row| row.policy == policy).collect();
            let of = |ratio: &dyn Fn(&ScaleRow) -> Option<f64>| {
                let points = own.iter().filter_map(|row| {
                    let (times, ratio) = (row.devices as f64 / base.devices as f64, ratio(row)?);
                    Some(match name {
                        "Amdahl" => (1.0 - 1.0 / times, ratio - 1.0 / times),
                        _ => (times - 1.0, times - row.work / ratio),
                    })
                });
                let (xy, xx) = points.fold((0.0, 0.0), |(xy, xx), (x, y)| (xy + x * y, xx + x * x));
                (xx > 0.0).then(|| xy / xx)
            };
            let turn = |turn: usize| of(&|row| Some(row.turns_ms.get(turn)? / base.turns_ms.get(turn)?));
            let turns: Vec<f64> = (0..base.turns_ms.len()).filter_map(turn).collect();
            let serial_share = of(&|row| Some(row.period_ms / base.period_ms))?;
            let interval = interval_of_median(&turns).map(|[a, b]| [a.min(serial_share), b.max(serial_share)]);
            Some(Self { policy: policy.to_owned(), name, serial_share, interval })
        };
        once(own.iter().map(|row| row.policy.as_str())).into_iter().filter_map(fit).collect()
    }

    /// Returns the speedup that the law gives `times` as many devices as the base has.
    fn speedup(&self, times: f64) -> f64 {
        let share = self.serial_share;
        if self.name == "Amdahl" { 1.0 / (share + (1.0 - share) / times) } else { times - share * (times - 1.0) }
    }
}

impl fmt::Display for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { policy, name, serial_share: share, interval } = self;
        write!(f, "{name}'s law, {policy}: {:.1} % of the time is serial", share * 100.0)?;
        if let Some([low, high]) = interval {
            write!(f, " ({:.1} to {:.1})", low * 100.0, high * 100.0)?;
        }
        if *name == "Amdahl" && (1e-3..1.0).contains(share) {
            write!(f, ", at most {:.1} times as fast with any number of devices", 1.0 / share)?;
        }
        Ok(())
    }
}

/// Plots speedup over device counts with a band for its interval, beside the ideal and the fitted law.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn scale_svg(title: String, rows: &[ScaleRow]) -> Result<String, ReportError> {
    let first = rows.first().map_or(1.0, |r| r.devices as f64);
    let counts = once(rows.iter().map(|r| r.devices as f64));
    let guide = |name: String, of: &dyn Fn(f64) -> f64| {
        let points = counts.iter().map(|count| (*count, of(count / first))).collect();
        Series { name, points, guide: true, ..Series::default() }
    };
    let mut series = vec![guide("ideal".into(), &|times| times)];
    let policies = once(rows.iter().map(|r| r.policy.as_str()));
    let of_policy = |what: String, policy: &str| if policies.len() > 1 { format!("{what}, {policy}") } else { what };
    for policy in &policies {
        // The line of every policy starts at the base, which is the first row.
        let own = || rows.iter().enumerate().filter(|(i, r)| *i == 0 || r.policy == *policy).map(|(_, row)| row);
        let band = |r: &ScaleRow| {
            let error = [r.speedup - r.speedup_error, r.speedup + r.speedup_error];
            (r.speedup_low.unwrap_or(error[0]), r.speedup_high.unwrap_or(error[1]))
        };
        series.push(Series {
            name: of_policy("measured".into(), policy),
            points: own().map(|r| (r.devices as f64, r.speedup)).collect(),
            labels: own().map(|r| r.limit.unwrap_or_default().to_owned()).collect(),
            band: Some(own().map(band).collect()),
            ..Series::default()
        });
    }
    for law in Law::of_rows(rows) {
        let name = format!("{}'s law, {:.0} % serial", law.name, law.serial_share * 100.0);
        series.push(guide(of_policy(name, &law.policy), &|times| law.speedup(times)));
    }
    let axis = |label: &str| Axis { label: label.to_owned(), log: true, doubles: true };
    line_chart_svg(&Chart { title, x: axis("devices"), y: axis("speed-up") }, &series)
}

/// Returns the sections of a page on scaling and its limits; `figure` is the plot.
pub fn scale_sections(rows: &[ScaleRow], figure: String) -> [Section; 2] {
    let scaling = "Makespan: median latency of a frame, from its plan until both images are on the primary. A frame \
        every: median interval between the ends of consecutive frames. The period is the makespan or, with several \
        frames in flight, that interval. Spread: interquartile range of the periods over their median. Speed-up: the \
        first row's period over this row's, times the pixels of this row over the first row's. Counts take turns, and \
        95 % intervals are those of the median over turns; fewer than six turns have none. Imbalance: busy time of the \
        busiest device over the mean. Transfers: host time spent in transfers; idle: time in which a queue ran no \
        stage; both as fractions of period times devices. Predicted off by: median error of the cost model's predicted \
        makespan, relative to the measured one.";
    let oversubscribed = "Oversubscribed: the devices together have more threads than there are cores, so they take \
        time from one another. Their speed-up says nothing about separate devices.";
    let limits = "Fractions of the devices' time (period times devices) by cause. Work: time in stages that the first \
        row's devices needed as well; ideally, all time is work. Slower stages: additional time for the same rows, \
        because devices share cores, caches or an adapter. Redundant rows: rows that several devices compute, such as \
        margins; they limit devices that have too few rows. Imbalance: idle time of devices with less work than the \
        busiest one. Then even the busiest device is idle: in transfers; in the serial part, before the first stage \
        and after the last one; and in other waits.";
    let mut notes = vec![scaling.to_owned()];
    notes.extend(rows.iter().any(|r| r.oversubscribed).then(|| oversubscribed.to_owned()));
    notes.extend(Law::of_rows(rows).iter().map(Law::to_string));
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

/// Returns a table that shows, for each device count, what limits the speedup.
fn limits_table(rows: &[ScaleRow]) -> Table {
    let columns: [Column<ScaleRow>; 10] = [
        ("devices", |row| row.devices.to_string()),
        ("work", |row| percent(1.0 - row.losses.all())),
        ("slower stages", |row| percent(row.losses.lost_slower)),
        ("redundant rows", |row| percent(row.losses.lost_redundant)),
        ("imbalance", |row| percent(row.losses.lost_imbalance)),
        ("transfers", |row| percent(row.losses.lost_transfers)),
        ("serial part", |row| percent(row.losses.lost_serial)),
        ("waits", |row| percent(row.losses.lost_waits)),
        ("limited by", |row| row.limit.unwrap_or("-").to_owned()),
        ("critical path, of the frames' time", |row| row.critical_path.clone()),
    ];
    Table::new(&columns, rows).with_policies(rows.iter().map(|r| r.policy.as_str()))
}
