//! Predictions depend only on measured frames. So the test checks them to rounding, however busy the machine is.

use std::collections::BTreeMap;

use crate::common::{Stage, Subject};
use diptych::control::TRACING;
use diptych::exec::{FrameReport, TimedTask};
use diptych::graph::{FrameGraph, Seam};
use diptych::passes::{Declarations, FrameSpec};
use diptych::scene::rig::Eye;
use diptych::schedule::{CostModel, Measured, RelativeCost, simulate_at};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 72;
const DEVICES: usize = 3;

/// Relative costs of frames that are predicted but not rendered.
const OTHERS: [f64; 2] = [1.0, 100.0];

fn work(factor: f64) -> RelativeCost {
    RelativeCost::new(TRACING.map(|stage| (stage, factor)))
}

/// Asserts that the model's costs equal the frame's measured times for each stage and device. This holds for the first
/// two frames; later ones enter a mean.
fn assert_learned(costs: &CostModel, report: &FrameReport) {
    let mut sums: BTreeMap<_, [f64; 2]> = BTreeMap::new();
    for task in &report.tasks {
        let TimedTask::Gpu(stage) = task.kind else { continue };
        let mut passes = report.program.passes().iter().map(|linked| &linked.pass);
        let pass = passes.find(|pass| (pass.stage, pass.view) == (stage, task.view)).unwrap();
        let sum = sums.entry((task.device, task.view == Eye::RIGHT, stage.name())).or_default();
        sum[0] += task.end_ms - task.begin_ms;
        sum[1] += costs.pass_ms(pass, task.device, &task.rows);
    }
    assert!(sums.len() > DEVICES, "{sums:?}");
    // A time of 0 carries no information.
    for (of, [measured_ms, learned_ms]) in sums.into_iter().filter(|(_, [measured_ms, _])| *measured_ms > 0.0) {
        assert!((learned_ms / measured_ms - 1.0).abs() < 1e-9, "{of:?}: {learned_ms} ms of {measured_ms}");
    }
}

#[track_caller]
fn assert_close(found: Option<f64>, expected: Option<f64>) {
    let is_close = match (found, expected) {
        (Some(found), Some(expected)) => (found / expected - 1.0).abs() < 1e-9,
        _ => found == expected,
    };
    assert!(is_close, "{found:?} ms instead of {expected:?}");
}

#[test]
fn predictions_use_previous_costs_and_relative_cost() {
    let subject = Subject::load("builtin:cornell");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let quality = settings.quality();
    let mut stage = Stage::with(&subject, &settings, DEVICES, Box::new(Measured::new(HEIGHT, DEVICES)));
    let mut ahead: Option<([Option<f64>; 2], Seam)> = None;
    for (index, factor) in [3.0, 2.0, 0.5, 1.0].into_iter().enumerate() {
        let relative_cost = work(factor);
        let of_frame = relative_cost.clone();
        stage.set(move |params| (params.quality, params.relative_cost) = (quality, of_frame.clone()));
        let before = stage.renderer().costs().clone();
        let report = stage.frame(index as u32).report;
        let graph = FrameGraph::build(&report.program, &report.assignment, None);
        let of =
            |costs: &CostModel, relative_cost: &RelativeCost| simulate_at(&graph, costs, relative_cost).makespan_ms;
        assert_close(report.predicted_ms, (index > 0).then(|| of(&before, &relative_cost)));
        // Predictions before the frame were for its stripes, at any quality, and for the halo plan of that time.
        if let Some((predicted, seam)) = ahead {
            let program = Declarations::default().program(&FrameSpec { seam, ..report.spec.clone() });
            let graph = FrameGraph::build(&program, &report.assignment, None);
            let of = |other: f64| simulate_at(&graph, &before, &work(other)).makespan_ms;
            let expected = OTHERS.map(|other| Some(of(other)));
            predicted.iter().zip(expected).for_each(|(found, expected)| assert_close(*found, expected));
        }
        if index < 2 {
            assert_learned(stage.renderer().costs(), &report);
        }
        let found = OTHERS.map(|other| stage.renderer().predicted_ms(&quality, &work(other)));
        assert!(found[1] > found[0], "{found:?}");
        ahead = Some((found, report.spec.seam));
    }
}
