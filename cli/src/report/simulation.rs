//! Reports predicted frame times for simulated numbers of devices: rows, CSV, table and plot.

use serde::Serialize;

use super::csv::{Column, Csv, number};
use super::plot::{Chart, Series, line_chart_svg};
use super::{ReportError, Table, cell, imbalance, once, shares_text};
use diptych::graph::TimedTask;
use diptych::schedule::Prediction;

/// One row of `simulate.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct SimulationRow {
    /// Name of the policy that distributes the rows.
    pub policy: &'static str,
    /// Number of machines, which have equally many devices.
    pub nodes: usize,
    /// Number of devices of all machines together.
    pub devices: usize,
    pub predicted_ms: f64,
    /// Makespan measured with this number of devices; `None` if there is no such measurement, if the row's nodes differ
    /// from those of the measured run, or if a simulated device has another speed than 1.
    pub measured_ms: Option<f64>,
    /// Makespan measured on one device, the base of speedups.
    pub base_ms: f64,
    /// Speedup over the base.
    pub speedup: f64,
    /// Speedup divided by the sum of the devices' speeds.
    pub efficiency: f64,
    pub imbalance: f64,
    /// Host time in transfers, as a fraction of the makespan times the number of devices.
    pub transfer_share: f64,
    pub limit: &'static str,
    /// Stages and transfers of the critical path.
    pub critical_path: Vec<PathShare>,
}

/// A stage, or all transfers, with its fraction of the makespan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PathShare {
    pub what: &'static str,
    pub share: f64,
}

impl SimulationRow {
    /// Summarises a prediction for devices of these speeds. `base_ms` is the measured makespan of one device of speed
    /// 1.
    pub fn new(prediction: &Prediction, speeds: &[f64], base_ms: f64, measured_ms: Option<f64>) -> Self {
        let devices = speeds.len();
        let speedup = base_ms / prediction.makespan_ms;
        let mut critical_path: Vec<PathShare> = Vec::new();
        for step in &prediction.critical_path {
            let what = match step.kind {
                TimedTask::Gpu(stage) => stage.name(),
                TimedTask::Download | TimedTask::Upload => "transfers",
            };
            let share = (step.end_ms - step.begin_ms) / prediction.makespan_ms;
            match critical_path.iter_mut().find(|part| part.what == what) {
                Some(part) => part.share += share,
                None => critical_path.push(PathShare { what, share }),
            }
        }
        Self {
            policy: "",
            nodes: 1,
            devices,
            predicted_ms: prediction.makespan_ms,
            measured_ms,
            base_ms,
            speedup,
            efficiency: speedup / speeds.iter().sum::<f64>(),
            imbalance: imbalance(&prediction.busy_ms),
            transfer_share: prediction.transfer_ms / (prediction.makespan_ms * devices as f64),
            limit: prediction.limit.name(),
            critical_path,
        }
    }

    /// Returns by which fraction of the measured makespan the simulation is too long; negative if it is too short.
    pub fn off(&self) -> Option<f64> {
        Some(self.predicted_ms / self.measured_ms? - 1.0)
    }

    fn critical_path_text(&self) -> String {
        shares_text(self.critical_path.iter().map(|part| (part.what, part.share)))
    }

    /// Returns the speedup of the measured makespan over the base.
    fn measured_speedup(&self) -> Option<f64> {
        Some(self.base_ms / self.measured_ms?)
    }
}

/// Largest deviation from measured makespans without a warning.
const MOST_OFF: f64 = 0.1;

/// Returns how far the simulation is off the measured makespans, and a warning for each count where it is far off.
pub fn deviations(rows: &[SimulationRow]) -> (Option<String>, Vec<String>) {
    let off = rows.iter().filter_map(|row| Some((row, row.off()?)));
    let most = off.clone().map(|(_, off)| off.abs()).reduce(f64::max);
    let far = off.filter(|(_, off)| off.abs() > MOST_OFF).map(|(row, off)| {
        let SimulationRow { devices, predicted_ms, .. } = row;
        let measured_ms = cell(row.measured_ms, 1);
        let off = off * 100.0;
        format!(
            "the simulation of {devices} device(s) is off by {off:+.0} %: {predicted_ms:.1} ms instead of {measured_ms}"
        )
    });
    let text = |most: f64| format!("the simulation is off by at most {:.0} % where it was measured", most * 100.0);
    (most.map(text), far.collect())
}

/// Minimum fraction of a frame's time that additional machines must save to be worthwhile.
const WORTH: f64 = 0.03;

/// Describes the number of machines beyond which additional machines with equally many devices do not pay off for this
/// frame. Returns `None` if all machines pay off, or if only one number of machines was simulated.
pub fn enough_nodes(rows: &[SimulationRow]) -> Option<String> {
    let mut by_nodes: Vec<&SimulationRow> = rows.iter().collect();
    let each = |row: &SimulationRow| row.devices / row.nodes.max(1);
    by_nodes.sort_by_key(|row| (each(row), row.nodes));
    let pays = |pair: &[&SimulationRow]| pair[1].predicted_ms < (1.0 - WORTH) * pair[0].predicted_ms;
    let stop = by_nodes
        .windows(2)
        .find(|pair| each(pair[0]) == each(pair[1]) && pair[0].nodes < pair[1].nodes && !pays(pair))?;
    let [less, more] = [stop[0], stop[1]];
    Some(format!(
        "more than {} node(s) of {} device(s) do not pay off: {} take {:.1} ms instead of {:.1} a frame, limited by {}",
        less.nodes,
        each(less),
        more.nodes,
        more.predicted_ms,
        less.predicted_ms,
        more.limit
    ))
}

const COLUMNS: [Column<SimulationRow>; 9] = [
    ("nodes", |r| r.nodes.to_string()),
    ("devices", |r| r.devices.to_string()),
    ("predicted_ms", |r| format!("{:.4}", r.predicted_ms)),
    ("measured_ms", |r| number(r.measured_ms, 4)),
    ("speedup", |r| format!("{:.4}", r.speedup)),
    ("efficiency", |r| format!("{:.4}", r.efficiency)),
    ("imbalance", |r| format!("{:.4}", r.imbalance)),
    ("transfer_share", |r| format!("{:.5}", r.transfer_share)),
    ("limit", |r| r.limit.to_owned()),
];

/// Returns the contents of `simulate.csv`: the values of a row, then a column for each stage on the critical path of
/// any row (and one for transfers) with its fraction of the makespan, then the policy and the base of
/// speedups.
pub fn simulation_csv(rows: &[SimulationRow]) -> Csv {
    let parts = once(rows.iter().flat_map(|r| r.critical_path.iter().map(|part| part.what)));
    let share =
        |row: &SimulationRow, what: &str| row.critical_path.iter().find(|p| p.what == what).map_or(0.0, |p| p.share);
    let shares = Csv {
        columns: parts.iter().map(|what| format!("critical_{what}_share")).collect(),
        lines: rows.iter().map(|r| parts.iter().map(|what| format!("{:.5}", share(r, what))).collect()).collect(),
    };
    let last: [Column<SimulationRow>; 3] = [
        ("policy", |r| r.policy.to_owned()),
        ("base_ms", |r| format!("{:.4}", r.base_ms)),
        ("predicted_off", |r| number(r.off(), 4)),
    ];
    Csv::new(&COLUMNS, rows).beside(shares).beside(Csv::new(&last, rows))
}

const SHOWN: [Column<SimulationRow>; 9] = [
    ("simulated", |r| match r.nodes {
        1 => r.devices.to_string(),
        nodes => format!("{nodes}x{}", r.devices / nodes),
    }),
    ("makespan ms", |r| format!("{:.1}", r.predicted_ms)),
    ("measured ms", |r| cell(r.measured_ms, 1)),
    ("off by", |r| r.off().map_or("-".to_owned(), |off| format!("{:+.1} %", off * 100.0))),
    ("speed-up", |r| format!("{:.2}", r.speedup)),
    ("efficiency", |r| format!("{:.2}", r.efficiency)),
    ("imbalance", |r| format!("{:.3}", r.imbalance)),
    ("limit", |r| r.limit.to_owned()),
    ("critical path", SimulationRow::critical_path_text),
];

pub fn simulation_table(rows: &[SimulationRow]) -> Table {
    Table::new(&SHOWN, rows).with_policies(rows.iter().map(|r| r.policy))
}

/// Plots simulated speedup over device counts, and measured speedup if there are measurements.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn simulation_svg(title: String, rows: &[SimulationRow]) -> Result<String, ReportError> {
    let line = |name: String, policy: Option<&str>, of: fn(&SimulationRow) -> Option<f64>, guide| {
        let own = rows.iter().filter(|r| policy.is_none_or(|policy| r.policy == policy));
        let mut points: Vec<_> = own.filter_map(|r| Some((r.devices as f64, of(r)?))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Series { name, points, guide, ..Series::default() }
    };
    let mut series = vec![line("ideal".to_owned(), None, |r| Some(r.speedup / r.efficiency), true)];
    let policies = once(rows.iter().map(|r| r.policy));
    for policy in &policies {
        let name = |what: &str| if policies.len() > 1 { format!("{what}, {policy}") } else { what.to_owned() };
        series.push(line(name("simulated"), Some(policy), |r| Some(r.speedup), false));
        if rows.iter().any(|r| r.policy == *policy && r.measured_ms.is_some()) {
            series.push(line(name("measured"), Some(policy), SimulationRow::measured_speedup, false));
        }
    }
    line_chart_svg(&Chart::new(title, ["devices", "speed-up over one measured device"], false), &series)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::graph::Stage;
    use diptych::scene::rig::Eye;
    use diptych::schedule::{Limit, Step};

    fn row() -> SimulationRow {
        let step = |kind, begin_ms, end_ms| Step { kind, view: Eye::LEFT, device: 0, begin_ms, end_ms };
        let critical_path = vec![
            step(TimedTask::Gpu(Stage("path_trace")), 0.0, 40.0),
            step(TimedTask::Download, 40.0, 42.0),
            step(TimedTask::Upload, 42.0, 43.0),
            step(TimedTask::Gpu(Stage("atrous")), 43.0, 50.0),
        ];
        let (makespan_ms, busy_ms, limit) = (50.0, vec![45.0, 15.0], Limit::Imbalance);
        SimulationRow::new(
            &Prediction { makespan_ms, tasks_ms: Vec::new(), busy_ms, transfer_ms: 4.0, critical_path, limit },
            &[1.0; 2],
            90.0,
            Some(60.0),
        )
    }

    #[test]
    fn row_compares_prediction_with_measurement() {
        let row = row();
        assert_eq!((row.devices, row.speedup, row.efficiency), (2, 1.8, 0.9));
        assert_eq!((row.imbalance, row.transfer_share, row.limit), (1.5, 0.04, "imbalance"));
        assert_eq!(row.critical_path_text(), "path_trace 80 % atrous 14 % transfers 6 %");
        assert_eq!(row.measured_speedup(), Some(1.5));
    }

    #[test]
    fn superfluous_nodes_are_named() {
        let of = |nodes, predicted_ms| SimulationRow { nodes, devices: 4 * nodes, predicted_ms, ..row() };
        assert_eq!(enough_nodes(&[of(1, 50.0), of(2, 30.0), of(4, 20.0)]), None);
        let said = enough_nodes(&[of(4, 29.5), of(1, 50.0), of(2, 30.0)]).unwrap();
        assert!(said.starts_with("more than 2 node(s)") && said.contains("29.5 ms instead of 30.0"), "{said}");
        // Four nodes of one device each are not compared with one node of four.
        let single = |nodes, predicted_ms| SimulationRow { devices: nodes, ..of(nodes, predicted_ms) };
        assert_eq!(enough_nodes(&[of(1, 50.0), single(1, 180.0), single(8, 40.0), of(2, 30.0)]), None);
    }

    #[test]
    fn unmeasured_rows_have_no_value_and_no_point() {
        let rows = [row(), SimulationRow { devices: 4, measured_ms: None, ..row() }];
        let table = simulation_csv(&rows);
        let known = ["devices", "predicted_ms", "measured_ms", "limit", "critical_atrous_share"];
        assert_eq!(known.map(|name| table.value(0, name)), ["2", "50.0000", "60.0000", "imbalance", "0.14000"]);
        assert!(table.columns.join(",").ends_with("policy,base_ms,predicted_off"), "{:?}", table.columns);
        assert_eq!((table.value(0, "predicted_off"), table.value(1, "predicted_off")), ("-0.1667", ""));
        assert_eq!(table.value(0, "base_ms"), "90.0000");
        assert_eq!((table.value(1, "devices"), table.value(1, "measured_ms")), ("4", ""));
        let dots = |rows: &[SimulationRow]| simulation_svg("t".into(), rows).unwrap().matches("<circle").count();
        assert_eq!((dots(&rows), dots(&rows[1..])), (3, 1));
    }

    #[test]
    fn far_simulations_have_a_warning() {
        let of = |measured_ms| SimulationRow { measured_ms, ..row() };
        assert_eq!(deviations(&[of(None)]), (None, Vec::new()));
        let (text, far) = deviations(&[of(None), of(Some(48.0))]);
        assert_eq!(
            (text.as_deref(), far.len()),
            (Some("the simulation is off by at most 4 % where it was measured"), 0)
        );
        let (text, far) = deviations(&[of(Some(40.0)), of(Some(52.0))]);
        assert!(text.unwrap().contains("at most 25 %"));
        assert_eq!(far, ["the simulation of 2 device(s) is off by +25 %: 50.0 ms instead of 40.0"]);
    }
}
