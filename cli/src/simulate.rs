//! `diptych scale --simulate`: predicts other device counts and speeds on a virtual clock, from measured costs.

use std::str::FromStr;

use anyhow::ensure;

use crate::report::scale::ScaleRow;
use crate::report::simulation::SimulationRow;
use diptych::frame::settings::Settings;
use diptych::graph::FrameGraph;
use diptych::passes::FrameSpec;
use diptych::schedule::{CostModel, Network, Prediction, simulate};

use super::failure::Failure;
use super::options::RenderOptions;
use super::registry::registered;
use super::setup;

#[derive(clap::Args, Debug)]
#[command(next_help_heading = super::options::DEVICES)]
pub struct Args {
    /// Predict these device counts from measured costs; 2x4 is two nodes of four
    #[arg(long, value_delimiter = ',', value_name = "N,MxN,…")]
    simulate: Vec<Nodes>,
}

/// Costs learned from the frames of a count.
pub struct Learned {
    pub devices: usize,
    pub policy: String,
    pub oversubscribed: bool,
    pub spec: FrameSpec,
    /// Costs after each turn that counts.
    pub costs: Vec<CostModel>,
}

/// A number of nodes with the same number of devices each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Nodes {
    nodes: usize,
    each: usize,
}

/// Maximum number of devices in a run.
const MOST_DEVICES: usize = 64;

impl FromStr for Nodes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (nodes, each) = text.split_once('x').unwrap_or(("1", text));
        let number = |text: &str| text.parse().ok().filter(|n| (1..=MOST_DEVICES).contains(n));
        let found = number(nodes).zip(number(each)).map(|(nodes, each)| Self { nodes, each });
        let found = found.filter(|found| found.nodes * found.each <= MOST_DEVICES);
        found.ok_or_else(|| format!("give 1 to {MOST_DEVICES} devices, e.g. 4, or nodes x devices per node, e.g. 2x4"))
    }
}

/// Latency of an unmeasured network: that of InfiniBand of 2015 and later.
const LATENCY_MS: f64 = 2e-3;
/// Bandwidth of such a network, Gbit/s.
const GBPS: f64 = 100.0;

/// Converts a bandwidth to milliseconds per byte.
fn ms_per_byte(gbps: f64) -> f64 {
    8e-6 / gbps
}

impl Args {
    pub fn is_wanted(&self) -> bool {
        !self.simulate.is_empty()
    }

    /// Checks constraints that clap cannot express.
    pub fn check(&self, options: &RenderOptions) -> Result<(), anyhow::Error> {
        let is_alone = !self.is_wanted() || options.settings.frames_in_flight <= 1;
        ensure!(is_alone, "--simulate runs one frame at a time: leave frames_in_flight out");
        let given = ["speeds", "network_us", "network_gbps"].into_iter().find(|key| options.settings.is_given(key));
        let idle = given.filter(|_| !self.is_wanted());
        ensure!(idle.is_none(), "{} has no effect without --simulate", idle.unwrap_or_default());
        Ok(())
    }

    /// Predicts frames on all requested counts, and on the measured ones, with costs that were learned from such
    /// frames. The first row is the base of speedups.
    pub fn run(
        &self,
        options: &RenderOptions,
        learned: &[Learned],
        measured: &[ScaleRow],
    ) -> Result<Vec<SimulationRow>, Failure> {
        let policy = options.settings.policy().name();
        // The base comes first, whatever its policy is.
        let is_own = |number: usize, of: &str| number == 0 || of == policy;
        let own = |number: &usize| is_own(*number, &learned[*number].policy);
        let own: Vec<usize> = (0..learned.len().min(measured.len())).filter(own).collect();
        let Some(base) = measured.first() else { return Ok(Vec::new()) };
        // A measured run has one node per rank.
        let ranks = crate::node::others().map_or(1, |node| node.ranks());
        let each_here = |number: usize| {
            let devices = learned[number].devices;
            devices.is_multiple_of(ranks).then_some(devices / ranks)
        };
        let is_alike = options.settings.speeds.iter().all(|speed| *speed == 1.0);
        let mut wanted = self.simulate.clone();
        let here = own.iter().filter_map(|number| Some(Nodes { nodes: ranks, each: each_here(*number)? }));
        wanted.extend(here.filter(|here| is_alike && !self.simulate.contains(here)));
        let mut rows = Vec::new();
        for Nodes { nodes, each } in wanted {
            let devices = nodes * each;
            let speeds: Vec<f64> = options.settings.speeds.iter().copied().cycle().take(devices).collect();
            // Devices that share cores, caches or an adapter take longer the more of them there are.
            let same = own.iter().copied().find(|number| each_here(*number) == Some(each));
            let largest = own.iter().copied().rfind(|number| !learned[*number].oversubscribed);
            let Learned { spec, costs, .. } = &learned[same.or(largest).unwrap_or(0)];
            let program = registered().program(&FrameSpec { devices, ..spec.clone() });
            let simulate = |costs: &CostModel| {
                let mut simulated = costs.on_devices(&program, &speeds);
                if nodes > 1 {
                    simulated.network = network(&options.settings, &costs.network, nodes, each);
                }
                predict(options, &simulated).map(|(_, prediction)| prediction)
            };
            // The measured makespan is a median over turns as well.
            let mut predictions = costs.iter().map(simulate).collect::<Result<Vec<_>, _>>()?;
            predictions.sort_by(|a, b| a.makespan_ms.total_cmp(&b.makespan_ms));
            let prediction = predictions.swap_remove(predictions.len() / 2);
            let here = same.filter(|_| is_alike && nodes == ranks).map(|number| measured[number].makespan_ms);
            rows.push(SimulationRow {
                policy,
                nodes,
                ..SimulationRow::new(&prediction, &speeds, base.makespan_ms, here)
            });
        }
        Ok(rows)
    }
}

/// Returns the network between nodes: as requested, else as measured, else with default values.
fn network(settings: &Settings, measured: &Network, nodes: usize, each: usize) -> Network {
    let known = |value: f64, otherwise: f64| if value > 0.0 { value } else { otherwise };
    Network {
        ranks: (0..nodes * each).map(|device| device / each).collect(),
        latency_ms: settings.network_us.map_or(known(measured.latency_ms, LATENCY_MS), |us| us * 1e-3),
        ms_per_byte: settings.network_gbps.map_or(known(measured.ms_per_byte, ms_per_byte(GBPS)), ms_per_byte),
    }
}

/// Maximum number of frames until stripes settle. It is enough for a boundary between two stripes to cross the whole
/// frame.
const SETTLING_FRAMES: u32 = 32;

/// Predicts the times of a frame after the stripes have settled. Returns the frame's graph, too.
pub fn predict(options: &RenderOptions, model: &CostModel) -> Result<(FrameGraph, Prediction), Failure> {
    let mut policy = setup::policy(options, model.program().extent, model.devices())?;
    let mut assignment = policy.assign(model);
    for _ in 0..SETTLING_FRAMES {
        let next = policy.assign(model);
        if next == assignment {
            break;
        }
        assignment = next;
    }
    let graph = FrameGraph::build(model.program(), &assignment, None);
    let prediction = simulate(&graph, model);
    Ok((graph, prediction))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_counts_parse_or_are_rejected() {
        assert_eq!("4".parse(), Ok(Nodes { nodes: 1, each: 4 }));
        assert_eq!("2x8".parse(), Ok(Nodes { nodes: 2, each: 8 }));
        for wrong in ["", "0", "x4", "2x", "2x0", "65", "9x8", "2x4x1", "-1", "9999999999999999999x2"] {
            assert!(wrong.parse::<Nodes>().is_err(), "{wrong}");
        }
    }
}
