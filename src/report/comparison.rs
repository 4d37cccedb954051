//! The table and the chart of `diptych play --compare-control`.

use serde::Serialize;

use super::csv::number;
use super::{Axis, Chart, Csv, ReportError, Series, Table, line_chart_svg};
use crate::control::ControllerKind;
use crate::report::play::PlaySummary;

/// A run of one controller.
#[derive(Clone, Debug, Serialize)]
pub struct ControlRun {
    pub controller: String,
    /// Number of the run, from 0. Runs of this number were played one after another.
    pub run: u32,
    pub missed_fraction: f64,
    pub above_share: f64,
    /// Mean FLIP of both eyes over the frames that were compared with references.
    pub flip: f64,
    pub makespan_ms_p50: f64,
    pub rung_changes: usize,
    /// Number and makespan (ms) of each frame.
    #[serde(skip)]
    pub makespans: Vec<(u32, f64)>,
}

impl ControlRun {
    pub fn new(kind: ControllerKind, run: u32, play: &PlaySummary, flip: f64, makespans: Vec<(u32, f64)>) -> Self {
        let PlaySummary { missed_fraction, above_share, makespan_ms_p50, rung_changes, .. } = *play;
        let controller = kind.to_string();
        Self { controller, run, missed_fraction, above_share, flip, makespan_ms_p50, rung_changes, makespans }
    }
}

/// Number of resampled means of an interval.
const RESAMPLED: usize = 2000;

/// Returns the mean and its 95 % bootstrap interval (Efron 1979): the quantiles of the means of values that are drawn
/// with replacement. From fewer than eight values the interval is too narrow. `None` without values.
fn mean_and_interval(values: &[f64]) -> Option<(f64, [f64; 2])> {
    let count = values.len();
    let mean = |sum: f64| sum / count as f64;
    let mut state = 1_u64;
    let mut draw = || {
        // PCG's multiplier; the upper bits are the random ones.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        values.get((state >> 33) as usize % count).copied().unwrap_or_default()
    };
    if count == 0 {
        return None;
    }
    let mut means: Vec<f64> = (0..RESAMPLED).map(|_| mean((0..count).map(|_| draw()).sum())).collect();
    means.sort_by(f64::total_cmp);
    let at = |quantile: f64| means[((RESAMPLED - 1) as f64 * quantile).round() as usize];
    Some((mean(values.iter().sum()), [at(0.025), at(0.975)]))
}

/// Returns the runs of each controller, in the order of their first runs.
fn by_controller(runs: &[ControlRun]) -> Vec<(&str, Vec<&ControlRun>)> {
    let mut groups: Vec<(&str, Vec<&ControlRun>)> = Vec::new();
    for run in runs {
        match groups.iter_mut().find(|(name, _)| *name == run.controller) {
            Some((_, group)) => group.push(run),
            None => groups.push((&run.controller, vec![run])),
        }
    }
    groups
}

/// Returns the contents of `comparison.csv`.
pub fn comparison_csv(runs: &[ControlRun]) -> Csv {
    Csv::new(
        &[
            ("controller", |r: &ControlRun| r.controller.clone()),
            ("run", |r| r.run.to_string()),
            ("missed_fraction", |r| number(Some(r.missed_fraction), 6)),
            ("above_share", |r| number(Some(r.above_share), 6)),
            ("flip", |r| number(Some(r.flip), 6)),
            ("makespan_ms_p50", |r| number(Some(r.makespan_ms_p50), 4)),
            ("rung_changes", |r| r.rung_changes.to_string()),
        ],
        runs,
    )
}

/// Returns a row per controller: means over its runs, and differences to the first controller's runs of the same
/// numbers, with their 95 % intervals.
pub fn comparison_table(runs: &[ControlRun]) -> Table {
    let groups = by_controller(runs);
    let (_, first) = groups.first().cloned().unwrap_or_default();
    let row = |(name, group): &(&str, Vec<&ControlRun>)| {
        let mean = |of: fn(&ControlRun) -> f64| {
            mean_and_interval(&group.iter().map(|run| of(run)).collect::<Vec<_>>()).map_or(f64::NAN, |(mean, _)| mean)
        };
        let pairs = || group.iter().zip(&first);
        let missed: Vec<f64> = pairs().map(|(a, b)| 100.0 * (a.missed_fraction - b.missed_fraction)).collect();
        let flip: Vec<f64> = pairs().map(|(a, b)| a.flip / b.flip).collect();
        let cell = |values: &[f64], decimals: usize, sign: bool| {
            let Some((mean, [low, high])) =
                mean_and_interval(values).filter(|_| group[0].controller != first[0].controller)
            else {
                return "-".to_owned();
            };
            match sign {
                true => format!("{mean:+.decimals$} ({low:+.decimals$} to {high:+.decimals$})"),
                false => format!("{mean:.decimals$} ({low:.decimals$} to {high:.decimals$})"),
            }
        };
        vec![
            (*name).to_owned(),
            format!("{:.2} %", 100.0 * mean(|run| run.missed_fraction)),
            format!("{:.2} %", 100.0 * mean(|run| run.above_share)),
            format!("{:.4}", mean(|run| run.flip)),
            format!("{:.1}", mean(|run| run.makespan_ms_p50)),
            format!("{:.0}", mean(|run| run.rung_changes as f64)),
            cell(&missed, 2, true),
            cell(&flip, 3, false),
        ]
    };
    Table {
        headers: vec![
            "controller",
            "missed",
            "above budget",
            "FLIP",
            "median ms",
            "changes",
            "missed, points more",
            "FLIP ratio",
        ],
        rows: groups.iter().map(row).collect(),
    }
}

/// Draws missed display periods over FLIP, a line through all pinned rungs and a dot for each other controller.
///
/// # Errors
/// [`ReportError::NothingToDraw`] without runs.
pub fn comparison_svg(title: String, runs: &[ControlRun]) -> Result<String, ReportError> {
    let mut series = vec![Series { name: "pinned rungs".to_owned(), ..Series::default() }];
    for (name, group) in by_controller(runs) {
        let mean = |of: fn(&ControlRun) -> f64| group.iter().map(|run| of(run)).sum::<f64>() / group.len() as f64;
        let point = (mean(|run| run.flip), 100.0 * mean(|run| run.missed_fraction));
        match name.starts_with("pinned:") {
            true => series[0].points.push(point),
            false => series.push(Series { name: name.to_owned(), points: vec![point], ..Series::default() }),
        }
    }
    series[0].points.sort_by(|a, b| a.0.total_cmp(&b.0));
    series.retain(|series| !series.points.is_empty());
    let axis = |label: &str| Axis { label: label.to_owned(), log: false };
    line_chart_svg(&Chart { title, x: axis("mean FLIP"), y: axis("missed display periods, %") }, &series)
}

/// Number of frames before and after a disturbance that [`recovery_svg`] shows.
const AROUND: [u32; 2] = [20, 80];

/// Draws the makespans of frames around the disturbance that begins at frame `at`, the median over runs of each
/// controller, and the budget.
///
/// # Errors
/// [`ReportError::NothingToDraw`] without runs.
pub fn recovery_svg(title: String, runs: &[ControlRun], at: u32, budget_ms: f64) -> Result<String, ReportError> {
    let shown = at.saturating_sub(AROUND[0])..at.saturating_add(AROUND[1]);
    let from = |frame: u32| f64::from(frame) - f64::from(at);
    let of = |(name, group): &(&str, Vec<&ControlRun>)| {
        let median = |frame: u32| {
            let frames = group.iter().flat_map(|run| &run.makespans);
            let mut times: Vec<f64> = frames.filter(|(index, _)| *index == frame).map(|(_, ms)| *ms).collect();
            times.sort_by(f64::total_cmp);
            Some((from(frame), *times.get(times.len() / 2)?))
        };
        Series { name: (*name).to_owned(), points: shown.clone().filter_map(median).collect(), ..Series::default() }
    };
    let mut series: Vec<Series> = by_controller(runs).iter().map(of).filter(|s| !s.points.is_empty()).collect();
    if !series.is_empty() {
        let points = vec![(from(shown.start), budget_ms), (from(shown.end), budget_ms)];
        series.push(Series { name: "budget".to_owned(), points, guide: true, ..Series::default() });
    }
    let axis = |label: &str| Axis { label: label.to_owned(), log: false };
    line_chart_svg(&Chart { title, x: axis("frames since the disturbance"), y: axis("makespan, ms") }, &series)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(controller: &str, run: u32, missed_fraction: f64, flip: f64) -> ControlRun {
        let (above_share, makespan_ms_p50, rung_changes) = (0.0, 12.0, 3);
        ControlRun {
            controller: controller.to_owned(),
            run,
            missed_fraction,
            above_share,
            flip,
            makespan_ms_p50,
            rung_changes,
            makespans: (0..200).map(|frame| (frame, 10.0 + f64::from(run))).collect(),
        }
    }

    #[test]
    fn frames_around_a_disturbance_are_drawn() {
        let runs = [run("a", 0, 0.0, 0.1), run("b", 0, 0.0, 0.1), run("a", 1, 0.0, 0.1)];
        let figure = recovery_svg("recovery".to_owned(), &runs, 100, 20.0).unwrap();
        assert!(figure.contains(">a</text>") || figure.contains("a\n"), "{figure}");
        assert!(figure.contains("budget") && figure.contains("frames since the disturbance"));
        assert!(recovery_svg("recovery".to_owned(), &[], 100, 20.0).is_err());
        assert!(recovery_svg("recovery".to_owned(), &runs, 5000, 20.0).is_err());
    }

    #[test]
    fn intervals_cover_the_means_of_samples() {
        assert_eq!(mean_and_interval(&[]), None);
        assert_eq!(mean_and_interval(&[2.0; 5]), Some((2.0, [2.0; 2])));
        // The standard error of the mean of 0, 1, …, 99 is 2.9, of which 1.96 are 5.7.
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        let (mean, [low, high]) = mean_and_interval(&values).unwrap();
        assert!((mean - 49.5).abs() < 1e-9);
        assert!((mean - low - 5.7).abs() < 0.6 && (high - mean - 5.7).abs() < 0.6, "{low} to {high}");
    }

    #[test]
    fn differences_are_between_runs_of_the_same_number() {
        // The machine is slower in the second run, for both.
        let runs = [run("a", 0, 0.01, 0.1), run("b", 0, 0.02, 0.05), run("a", 1, 0.21, 0.2), run("b", 1, 0.22, 0.1)];
        let table = comparison_table(&runs);
        assert_eq!(table.rows[0][6..], ["-", "-"]);
        assert_eq!(table.rows[1][1], "12.00 %");
        assert_eq!(table.rows[1][6..], ["+1.00 (+1.00 to +1.00)", "0.500 (0.500 to 0.500)"]);
        assert_eq!(comparison_csv(&runs).value(3, "missed_fraction"), "0.220000");
    }

    #[test]
    fn the_chart_joins_pinned_rungs() {
        let runs = [run("pinned:3", 0, 0.01, 0.1), run("diptych", 0, 0.01, 0.1), run("pinned:1", 0, 0.0, 0.2)];
        let figure = comparison_svg("controllers".to_owned(), &runs).unwrap();
        assert!(figure.contains("pinned rungs") && figure.contains("diptych") && !figure.contains("pinned:1"));
    }
}
