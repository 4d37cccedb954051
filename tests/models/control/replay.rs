//! Replays recorded costs: controllers choose rungs, the cost model learns from the frames that follow, and disturbances
//! change the costs.

use std::sync::Arc;

use diptych::control::{Budget, Control};
use diptych::graph::{Assignment, FrameGraph, Stripes};
use diptych::passes::Declarations;
use diptych::schedule::{CostModel, simulate_at};

use super::recorded::{Recording, Sample};
use crate::reference::sampling::Rng;

/// A change from one frame on. It holds until the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    None,
    /// Path tracing costs so many times as much, as in another view.
    View(f64),
    /// All stages take so many times as long, and the controller is told, as after the loss of a device.
    Lost(f64),
    /// The budget is multiplied, and the controller is told.
    Budget(f64),
}

/// Disturbances by the frame at which they begin.
pub type Schedule<'a> = &'a [(usize, Disturbance)];

pub fn budget(hi_ms: f64) -> Budget {
    Budget::new(0.5 * hi_ms, hi_ms).unwrap()
}

/// A frame of a replay.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    pub rung: usize,
    pub ms: f64,
    pub predicted_ms: f64,
    pub budget_ms: f64,
    pub error: f64,
}

impl Step {
    /// Returns the number of display periods by which the frame is late.
    pub fn missed(&self) -> usize {
        ((self.ms / self.budget_ms).ceil() - 1.0).max(0.0) as usize
    }
}

pub struct Replay<'a> {
    pub recording: &'a Recording,
    pub schedule: Schedule<'a>,
    pub budget_ms: f64,
    pub seed: u64,
}

impl Replay<'_> {
    pub fn run(&self, controller: &mut dyn Control, frames: usize) -> Vec<Step> {
        let Self { recording, schedule, .. } = *self;
        let rungs = recording.ladder.rungs();
        let graphs: Vec<Arc<FrameGraph>> = (0..rungs.len()).map(|rung| graph(recording, rung)).collect();
        let mut model = CostModel::new(&graphs[0].program, recording.spec(0).devices);
        let mut random = Rng::new(self.seed, 0);
        let mut places = Places::new(recording);
        let mut steps = Vec::with_capacity(frames);
        let mut disturbance = Disturbance::None;
        let mut budget_ms = self.budget_ms;
        for frame in 0..frames {
            if let Some(&(_, next)) = schedule.iter().find(|(at, _)| *at == frame) {
                let is_known = |d: &Disturbance| matches!(d, Disturbance::Lost(_));
                if is_known(&next) || is_known(&disturbance) {
                    controller.devices_changed();
                }
                disturbance = next;
                let factor = if let Disturbance::Budget(factor) = next { factor } else { 1.0 };
                budget_ms = self.budget_ms * factor;
                controller.set_budget(budget(budget_ms));
            }
            let predict = |rung: usize| {
                let known = model.has_learned();
                let predicted = known.then(|| simulate_at(&graphs[rung], &model, &recording.relative_costs[rung]));
                predicted.map_or(f64::NAN, |p| p.makespan_ms)
            };
            let rung = controller.next(&predict).rung;
            let predicted_ms = predict(rung);
            let (repeat, place) = places.next(&mut random);
            let sample = disturbed(recording.sample(repeat, place, rung), disturbance);
            let ms = sample.ms();
            steps.push(Step { rung, ms, predicted_ms, budget_ms, error: rungs[rung].error });
            model.plan_for(&graphs[rung].program, &recording.relative_costs[rung]);
            model.learn(&recording.costs(rung, &sample));
            controller.observe(rung, ms);
        }
        steps
    }
}

pub fn disturbed(sample: &Sample, disturbance: Disturbance) -> Sample {
    match disturbance {
        Disturbance::View(factor) => sample.with_rays(factor),
        Disturbance::Lost(factor) => sample.slowed(factor),
        Disturbance::None | Disturbance::Budget(_) => sample.clone(),
    }
}

fn graph(recording: &Recording, rung: usize) -> Arc<FrameGraph> {
    let program = Declarations::default().program(&recording.spec(rung));
    let assignment = Assignment::uniform(Stripes::even(recording.extent.height, 1));
    Arc::new(FrameGraph::build(&program, &assignment, None))
}

/// Order in which frames are replayed: forwards, each turn from a random repeat, and again from the start.
struct Places {
    turn: usize,
    repeats: usize,
    frames: usize,
    repeat: usize,
    frame: usize,
}

impl Places {
    fn new(recording: &Recording) -> Self {
        Self { turn: recording.turn, repeats: recording.repeats(), frames: recording.frames(), repeat: 0, frame: 0 }
    }

    fn next(&mut self, random: &mut Rng) -> (usize, usize) {
        if (self.frame % self.frames).is_multiple_of(self.turn) {
            self.repeat = (random.uniform() * self.repeats as f64) as usize % self.repeats;
        }
        let place = (self.repeat, self.frame % self.frames);
        self.frame += 1;
        place
    }
}
