//! The table and the chart of controllers that `diptych play` compares.

use serde::Serialize;

use super::csv::Column;
use super::intervals::interval;
use super::statistics::mean;
use super::{Chart, Csv, ReportError, Series, Table, line_chart_svg, once};
use crate::report::play::PlaySummary;
use diptych::control::ControllerKind;

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

/// Returns the runs of each controller, in the order of their first runs.
fn by_controller(runs: &[ControlRun]) -> Vec<(&str, Vec<&ControlRun>)> {
    let names = once(runs.iter().map(|run| run.controller.as_str()));
    names.into_iter().map(|name| (name, runs.iter().filter(|run| run.controller == name).collect())).collect()
}

/// Returns the contents of `comparison.csv`.
pub fn comparison_csv(runs: &[ControlRun]) -> Csv {
    const COLUMNS: [Column<ControlRun>; 7] = [
        ("controller", |r| r.controller.clone()),
        ("run", |r| r.run.to_string()),
        ("missed_fraction", |r| format!("{:.6}", r.missed_fraction)),
        ("above_share", |r| format!("{:.6}", r.above_share)),
        ("flip", |r| format!("{:.6}", r.flip)),
        ("makespan_ms_p50", |r| format!("{:.4}", r.makespan_ms_p50)),
        ("rung_changes", |r| r.rung_changes.to_string()),
    ];
    Csv::new(&COLUMNS, runs)
}

/// Returns a row per controller: means over its runs, and differences to the first controller's runs of the same
/// numbers, with their 95 % intervals. The ratio of FLIP is a geometric mean.
pub fn comparison_table(runs: &[ControlRun]) -> Table {
    let groups = by_controller(runs);
    let (_, first) = groups.first().cloned().unwrap_or_default();
    let row = |(name, group): &(&str, Vec<&ControlRun>)| {
        let of_runs = |of: fn(&ControlRun) -> f64| mean(&group.iter().map(|run| of(run)).collect::<Vec<_>>());
        let is_first = group[0].controller == first[0].controller;
        let difference = |of: fn(&ControlRun, &ControlRun) -> f64, write: fn(f64) -> String| {
            let pairs: Vec<f64> = group.iter().zip(&first).map(|(a, b)| of(a, b)).collect();
            let range = interval(&pairs).map(|ends| ends.map(write).join(" to "));
            match (is_first, range) {
                (true, _) => "-".to_owned(),
                (false, None) => write(mean(&pairs)),
                (false, Some(range)) => format!("{} ({range})", write(mean(&pairs))),
            }
        };
        vec![
            (*name).to_owned(),
            group.len().to_string(),
            format!("{:.2} %", 100.0 * of_runs(|run| run.missed_fraction)),
            format!("{:.2} %", 100.0 * of_runs(|run| run.above_share)),
            format!("{:.4}", of_runs(|run| run.flip)),
            format!("{:.1}", of_runs(|run| run.makespan_ms_p50)),
            format!("{:.0}", of_runs(|run| run.rung_changes as f64)),
            difference(|a, b| 100.0 * (a.missed_fraction - b.missed_fraction), |points| format!("{points:+.2}")),
            difference(|a, b| (a.flip / b.flip).ln(), |log| format!("{:.3}", log.exp())),
        ]
    };
    let mut headers = vec!["controller", "runs", "missed", "above budget", "FLIP", "median ms", "changes"];
    headers.extend(["missed, points more (95 %)", "FLIP ratio (95 %)"]);
    Table { headers, rows: groups.iter().map(row).collect() }
}

/// Draws missed display periods over FLIP, a line through all pinned rungs and a dot for each other controller.
///
/// # Errors
/// [`ReportError::NothingToDraw`] without runs.
pub fn comparison_svg(title: String, runs: &[ControlRun]) -> Result<String, ReportError> {
    let mut series = vec![Series { name: "pinned rungs".to_owned(), ..Series::default() }];
    for (name, group) in by_controller(runs) {
        let mean = |of: fn(&ControlRun) -> f64| mean(&group.iter().map(|run| of(run)).collect::<Vec<_>>());
        let point = (mean(|run| run.flip), 100.0 * mean(|run| run.missed_fraction));
        match name.starts_with("pinned:") {
            true => series[0].points.push(point),
            false => series.push(Series { name: name.to_owned(), points: vec![point], ..Series::default() }),
        }
    }
    series[0].points.sort_by(|a, b| a.0.total_cmp(&b.0));
    series.retain(|series| !series.points.is_empty());
    line_chart_svg(&Chart::new(title, ["mean FLIP", "missed display periods, %"], false), &series)
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
    line_chart_svg(&Chart::new(title, ["frames since the disturbance", "makespan, ms"], false), &series)
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
    fn one_run_or_equal_runs_have_no_interval() {
        assert_eq!([interval(&[]), interval(&[2.0]), interval(&[2.0; 5]), interval(&[1.0, f64::NAN])], [None; 4]);
        let table = comparison_table(&[run("a", 0, 0.01, 0.1), run("b", 0, 0.02, 0.05)]);
        assert_eq!(table.rows[1][7..], ["+1.00", "0.500"]);
    }

    #[test]
    fn runs_are_compared_pairwise_by_number() {
        // The machine is slower in the second run, for both.
        let runs = [run("a", 0, 0.01, 0.1), run("b", 0, 0.02, 0.05), run("a", 1, 0.21, 0.2), run("b", 1, 0.221, 0.1)];
        let table = comparison_table(&runs);
        assert_eq!(table.rows[0][1..3], ["2", "11.00 %"]);
        assert_eq!(table.rows[0][7..], ["-", "-"]);
        assert_eq!(table.rows[1][2], "12.05 %");
        // The points are 1.00 and 1.10, whose mean has a standard error of 0.05.
        assert_eq!(table.rows[1][7..], ["+1.05 (+0.41 to +1.69)", "0.500"]);
        assert_eq!(comparison_csv(&runs).value(3, "missed_fraction"), "0.221000");
    }

    #[test]
    fn chart_joins_pinned_rungs() {
        let runs = [run("pinned:3", 0, 0.01, 0.1), run("diptych", 0, 0.01, 0.1), run("pinned:1", 0, 0.0, 0.2)];
        let figure = comparison_svg("controllers".to_owned(), &runs).unwrap();
        assert!(figure.contains("pinned rungs") && figure.contains("diptych") && !figure.contains("pinned:1"));
    }
}
