//! `diptych scale --simulate`: device counts and speeds that are not here, on a virtual clock with measured costs.

use diptych::graph::FrameGraph;
use diptych::report::simulation::Row;
use diptych::schedule::{CostModel, Prediction, simulate};

use super::failure::Failure;
use super::options::RenderOptions;
use super::setup;

#[derive(clap::Args, Debug)]
#[command(next_help_heading = super::options::DEVICES)]
pub struct Args {
    /// Predict these device counts as well, from costs measured on the most devices that fit the cores
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64))]
    simulate: Vec<u16>,
    /// Speeds of simulated devices, 1: as measured; repeated for as many as there are
    #[arg(long, value_delimiter = ',', value_name = "S,S,…", default_value = "1", requires = "simulate")]
    speeds: Vec<f64>,
}

impl Args {
    pub fn is_wanted(&self) -> bool {
        !self.simulate.is_empty()
    }

    /// What clap cannot see.
    pub fn check(&self, options: &RenderOptions) -> Result<(), Failure> {
        if self.is_wanted() && options.frames_in_flight > 1 {
            let what = "--simulate plays frames one after another: leave --frames-in-flight out";
            return Err(Failure::Input(anyhow::anyhow!(what)));
        }
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
        let one_ms = predict(options, &model.on_devices(&[1.0]))?.1.makespan_ms;
        let mut rows = Vec::new();
        for &count in &self.simulate {
            let devices = usize::from(count);
            let speeds: Vec<f64> = self.speeds.iter().copied().cycle().take(devices).collect();
            let (_, prediction) = predict(options, &model.on_devices(&speeds))?;
            let is_alike = speeds.iter().all(|&s| s == 1.0);
            let here = measured.iter().find(|(d, _)| is_alike && *d == devices);
            rows.push(Row::new(&prediction, &speeds, one_ms, here.map(|(_, ms)| *ms)));
        }
        Ok(rows)
    }
}

/// Frames after which stripes that still move are taken as they are: an edge has crossed the frame by then.
const SETTLING_FRAMES: u32 = 32;

/// A frame once its stripes have settled.
pub fn predict(options: &RenderOptions, model: &CostModel) -> Result<(FrameGraph, Prediction), Failure> {
    let mut policy = setup::policy(options, model.spec().extent, model.spec().devices)?;
    let mut assignment = policy.assign(model);
    for _ in 0..SETTLING_FRAMES {
        let next = policy.assign(model);
        if next == assignment {
            break;
        }
        assignment = next;
    }
    let graph = FrameGraph::build(model.program(), &assignment, None);
    let prediction = simulate(&graph, model).map_err(|e| Failure::Run(e.into()))?;
    Ok((graph, prediction))
}
