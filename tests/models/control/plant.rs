//! Simulates a renderer for tests of the controller: a frame's time is the cost of its rung, times the load, times
//! noise. Its predictions learn the load from measured frames, as a cost model does.

use std::collections::VecDeque;

use diptych::control::{Budget, Control, Controller, Decision, Ladder, Measure, Origin, Rung};
use diptych::quality::Quality;

use crate::reference::sampling::Rng;

pub const LO_MS: f64 = 11.0;
pub const HI_MS: f64 = 20.0;

/// Creates a ladder whose rungs take these times.
pub fn ladder(times_ms: &[f64]) -> Ladder {
    let rung = |(i, &time_ms): (usize, &f64)| Rung {
        time_ms,
        error: 0.9 / (i + 1) as f64,
        flip: Some(0.8 / (i + 1) as f64),
        flicker: Some(0.1 / (i + 1) as f64),
        relmse: Some(0.1),
        is_estimated: false,
        quality: Quality { spp: (i as u32 + 1).into(), filter: None, ..Quality::default() },
        stage_ms: Default::default(),
        rays: Default::default(),
    };
    let (shot, size, devices, version) = ("s".into(), "8x8".into(), vec!["d".into()], "0".into());
    let measure = Measure::FlipFlicker;
    let origin = Origin { shot, size, exposure_ev: -0.5, measure, devices, version };
    Ladder::new(origin, times_ms.iter().enumerate().map(rung).collect()).unwrap()
}

/// Returns a ladder's times: from `floor_ms` up by these factors.
pub fn times(floor_ms: f64, steps: &[f64]) -> Vec<f64> {
    let mut times_ms = vec![floor_ms];
    for step in steps {
        times_ms.push(times_ms[times_ms.len() - 1] * step);
    }
    times_ms
}

pub struct Plant<'a> {
    /// Cost of the rungs under a load of 1.
    pub times_ms: &'a [f64],
    /// Load by frame.
    pub load: &'a dyn Fn(usize) -> f64,
    /// Cost of the rungs as the predictor believes, under a load of 1; by default the true one.
    pub believed_ms: Option<&'a [f64]>,
    /// Standard deviation of the logarithm.
    pub noise: f64,
    pub seed: u64,
    /// Number of further frames that are decided before a frame's time is known.
    pub delay: usize,
}

impl<'a> Plant<'a> {
    /// Creates a plant without noise, in which each frame's time is known when the next one is decided.
    pub fn new(times_ms: &'a [f64], load: &'a dyn Fn(usize) -> f64) -> Self {
        Self { times_ms, load, believed_ms: None, noise: 0.0, seed: 0, delay: 0 }
    }

    pub fn run(&self, frames: usize) -> Run {
        let budget = Budget::new(LO_MS, HI_MS).unwrap();
        self.run_with(Controller::new(&ladder(self.times_ms), budget), frames)
    }

    pub fn run_with(&self, mut controller: Controller, frames: usize) -> Run {
        let mut random = Rng::new(self.seed, 0);
        let (mut steps, mut in_flight) = (Vec::new(), VecDeque::new());
        let believed_ms = self.believed_ms.unwrap_or(self.times_ms);
        let mut load = Load::default();
        for frame in 0..frames {
            if in_flight.len() > self.delay {
                let (rung, ms) = in_flight.pop_front().unwrap();
                load.learn(ms / believed_ms[rung]);
                controller.observe(rung, ms);
            }
            let decision = controller.next(&|rung: usize| load.value * believed_ms[rung]);
            let mean_ms = self.times_ms[decision.rung] * (self.load)(frame);
            let ms = mean_ms * (self.noise * random.normal()).exp();
            in_flight.push_back((decision.rung, ms));
            steps.push(Step { decision, mean_ms, ms });
        }
        Run(steps)
    }
}

/// A load that is learned like a time per unit of work: a running mean, which leaps where the median of the last three
/// measurements is far from it.
struct Load {
    value: f64,
    last: Vec<f64>,
}

impl Default for Load {
    fn default() -> Self {
        Self { value: 1.0, last: Vec::new() }
    }
}

impl Load {
    fn learn(&mut self, measured: f64) {
        self.last.push(measured);
        let mut last: Vec<f64> = self.last.iter().rev().take(3).copied().collect();
        last.sort_by(f64::total_cmp);
        let median = last[last.len() / 2];
        let usual = self.value / 1.4..=self.value * 1.4;
        self.value = match self.last.len() {
            1 => measured,
            2.. if last.len() == 3 && !usual.contains(&median) => median,
            _ => self.value + 0.1 * (measured.clamp(*usual.start(), *usual.end()) - self.value),
        };
    }
}

pub struct Step {
    pub decision: Decision,
    /// Time without noise.
    pub mean_ms: f64,
    pub ms: f64,
}

pub struct Run(pub Vec<Step>);

impl Run {
    /// Returns the frames from `begin` on whose rung differs from that of the previous frame.
    pub fn changes_from(&self, begin: usize) -> usize {
        self.0[begin..].windows(2).filter(|pair| pair[0].decision.rung != pair[1].decision.rung).count()
    }

    /// Returns the fraction of frames from `begin` on with this property.
    pub fn share_from(&self, begin: usize, is_so: impl Fn(&Step) -> bool) -> f64 {
        let frames = &self.0[begin..];
        frames.iter().filter(|s| is_so(s)).count() as f64 / frames.len() as f64
    }
}
