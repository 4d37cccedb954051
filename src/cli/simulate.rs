//! `diptych scale --simulate`: device counts and speeds that are not here, on a virtual clock with measured costs.

use std::io::Write;

use serde::Serialize;

use diptych::graph::FrameGraph;
use diptych::image::file::atomic_write;
use diptych::report::text_table;
use diptych::schedule::{CostModel, Prediction, StepKind, simulate};

use super::failure::Failure;
use super::options::RenderOptions;
use super::setup;

#[derive(clap::Args, Debug)]
pub struct Args {
    /// Predict these device counts as well, from costs measured on the most devices that fit the cores
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64))]
    simulate: Vec<u16>,
    /// Speeds of simulated devices, 1: as measured; repeated for as many as there are
    #[arg(long, value_delimiter = ',', value_name = "S,S,…", default_value = "1", requires = "simulate")]
    speeds: Vec<f64>,
}

/// One row of `simulate.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    devices: usize,
    predicted_ms: f64,
    /// Of devices that are here, where every simulated one has speed 1.
    measured_ms: Option<f64>,
    /// Over one device of speed 1.
    speedup: f64,
    /// Speed-up over the sum of speeds.
    efficiency: f64,
    imbalance: f64,
    /// Host time in transfers over the makespan times the devices.
    transfer_share: f64,
    limit: &'static str,
    critical_path: String,
}

impl Args {
    pub fn is_wanted(&self) -> bool {
        !self.simulate.is_empty()
    }

    /// What clap cannot see.
    pub fn check(&self) -> Result<(), Failure> {
        match self.speeds.iter().find(|s| !s.is_finite() || **s <= 0.0) {
            Some(speed) => Err(Failure::Input(anyhow::anyhow!("--speeds {speed} is not a speed above 0"))),
            None => Ok(()),
        }
    }

    /// Predicts every count. `measured` are device counts with their makespans in milliseconds.
    pub fn run(
        &self,
        options: &RenderOptions,
        model: &CostModel,
        measured: &[(usize, f64)],
    ) -> Result<Vec<Row>, Failure> {
        let one_ms = predict(options, &model.on_devices(&[1.0]))?.makespan_ms;
        let mut rows = Vec::new();
        for &count in &self.simulate {
            let devices = usize::from(count);
            let speeds: Vec<f64> = self.speeds.iter().copied().cycle().take(devices).collect();
            let prediction = predict(options, &model.on_devices(&speeds))?;
            let is_alike = speeds.iter().all(|&s| s == 1.0);
            let here = measured.iter().find(|(d, _)| is_alike && *d == devices);
            rows.push(Row::new(&prediction, &speeds, one_ms, here.map(|(_, ms)| *ms)));
        }
        write(&options.out.join("simulate.csv"), &rows)?;
        Ok(rows)
    }
}

/// Frames after which stripes that still move are taken as they are: an edge has crossed the frame by then.
const SETTLING_FRAMES: u32 = 32;

/// A frame once its stripes have settled.
fn predict(options: &RenderOptions, model: &CostModel) -> Result<Prediction, Failure> {
    let mut policy = setup::policy(options, model.spec().devices)?;
    let mut assignment = policy.assign(model);
    for _ in 0..SETTLING_FRAMES {
        let next = policy.assign(model);
        if next == assignment {
            break;
        }
        assignment = next;
    }
    simulate(&FrameGraph::build(model.spec(), &assignment), model).map_err(|e| Failure::Run(e.into()))
}

impl Row {
    fn new(prediction: &Prediction, speeds: &[f64], one_ms: f64, measured_ms: Option<f64>) -> Self {
        let devices = speeds.len();
        let busy = &prediction.busy_ms;
        let speedup = one_ms / prediction.makespan_ms;
        Self {
            devices,
            predicted_ms: prediction.makespan_ms,
            measured_ms,
            speedup,
            efficiency: speedup / speeds.iter().sum::<f64>(),
            imbalance: busy.iter().copied().fold(0.0, f64::max) * devices as f64 / busy.iter().sum::<f64>().max(1e-9),
            transfer_share: prediction.transfer_ms / (prediction.makespan_ms * devices as f64),
            limit: prediction.limit.name(),
            critical_path: summary(prediction),
        }
    }
}

/// Shares of the makespan that the critical path spends in what, largest first: `path_trace 61 % atrous 30 %`.
fn summary(prediction: &Prediction) -> String {
    let mut shares: Vec<(&str, f64)> = Vec::new();
    for step in &prediction.critical_path {
        let name = match step.kind {
            StepKind::Stage(stage) => stage.name(),
            StepKind::Download | StepKind::Upload => "transfers",
            StepKind::Stitch => continue,
        };
        let share = (step.end_ms - step.begin_ms) / prediction.makespan_ms;
        match shares.iter_mut().find(|(n, _)| *n == name) {
            Some((_, sum)) => *sum += share,
            None => shares.push((name, share)),
        }
    }
    shares.sort_by(|a, b| b.1.total_cmp(&a.1));
    let shown = shares.iter().filter(|(_, share)| *share >= 0.005);
    shown.map(|(name, share)| format!("{name} {:.0} %", share * 100.0)).collect::<Vec<_>>().join(" ")
}

fn write(path: &std::path::Path, rows: &[Row]) -> Result<(), Failure> {
    atomic_write(path, |file| {
        writeln!(
            file,
            "devices,predicted_ms,measured_ms,speedup,efficiency,imbalance,transfer_share,limit,critical_path"
        )?;
        for r in rows {
            let measured = r.measured_ms.map_or(String::new(), |ms| format!("{ms:.4}"));
            writeln!(
                file,
                "{},{:.4},{measured},{:.4},{:.4},{:.4},{:.5},{},{}",
                r.devices,
                r.predicted_ms,
                r.speedup,
                r.efficiency,
                r.imbalance,
                r.transfer_share,
                r.limit,
                r.critical_path
            )?;
        }
        Ok(())
    })?;
    Ok(())
}

pub fn print_table(rows: &[Row]) {
    let cells: Vec<Vec<String>> = rows
        .iter()
        .map(|r| {
            vec![
                r.devices.to_string(),
                format!("{:.1}", r.predicted_ms),
                r.measured_ms.map_or("-".into(), |ms| format!("{ms:.1}")),
                format!("{:.2}", r.speedup),
                format!("{:.2}", r.efficiency),
                format!("{:.3}", r.imbalance),
                r.limit.into(),
                r.critical_path.clone(),
            ]
        })
        .collect();
    let headers =
        ["simulated", "makespan ms", "measured ms", "speed-up", "efficiency", "imbalance", "limit", "critical path"];
    say!("{}", text_table(&headers, &cells).trim_end());
}
