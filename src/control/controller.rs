//! Picks the rung of the next frame.
//!
//! The target is the rung of least error that is predicted to fit the budget with headroom for the scatter of frames.
//! The headroom is a quantile of the ratio of measured to predicted times of the last frames, such that a fraction
//! [`LATE`] of them would exceed it. The predictor alone learns costs.
//!
//! The controller drops at once if the current rung is predicted not to fit, or if two of its last three frames were
//! late. It climbs after [`QUIET`] frames in time.

use std::collections::VecDeque;

use super::{Budget, Ladder};

/// Number of frames in time on the current rung after which the controller may climb.
pub const QUIET: usize = 3;
/// Fraction of frames that may be late.
pub const LATE: f64 = 0.02;
/// Number of frames whose scatter determines the headroom.
const WINDOW: usize = 500;
/// Assumed scatter before the first frame: values and their numbers.
const FIRST_SCATTER: [(f64, usize); 2] = [(0.0, 48), (0.25, 2)];
/// Maximum of the headroom, a logarithm.
const MOST_HEADROOM: f64 = std::f64::consts::LN_2;
/// Factor of the predicted time by which a rung must fit to be climbed to, and by which the current rung may exceed the
/// budget before the controller drops. The gap prevents oscillation.
const HYSTERESIS: f64 = 1.02;
/// Number of late frames on a rung, since the climb to it, that lock it out.
const STRIKES: u32 = 3;
/// Number of decisions for which a rung is locked out, and after a climb for which late frames count as strikes.
const LOCKED: u64 = 32;
/// Number of frames after the start and after a known disturbance that do not change the headroom.
const SETTLING: u64 = 8;
/// Number of decisions whose frames may be in flight.
const IN_FLIGHT: usize = 16;
/// Maximum ratio of a measured to a predicted time. Clocks and predictors that are off by more are broken.
const RATIO_MAX: f64 = 1e3;

/// Chooses the rungs of a run's frames.
pub trait Control: Send {
    /// Picks the rung of the next frame. `predict` returns the makespan of the next frame on a rung, in ms. The ladder's
    /// own measurement replaces any value that is not positive and finite.
    fn next(&mut self, predict: &dyn Fn(usize) -> f64) -> Decision;

    /// Adds the time of a finished frame. A [`Session`](crate::Session) passes its whole time, which is its makespan and
    /// the host's time before and after.
    fn observe(&mut self, rung: usize, makespan_ms: f64);

    /// Adapts to devices that were added, removed or changed in speed.
    fn devices_changed(&mut self) {}

    /// Replaces the budget.
    fn set_budget(&mut self, budget: Budget);
}

/// The choice of the next frame's rung.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Index into the ladder's rungs.
    pub rung: usize,
    /// The prediction of the frame's makespan.
    pub expected_ms: f64,
    /// False if no rung is expected to stay within the budget. The rung is then the cheapest.
    pub fits: bool,
}

/// Late frames of a rung since the last climb to it.
#[derive(Clone, Copy, Debug, Default)]
struct Trial {
    /// Number of the decision to climb.
    climbed_at: u64,
    strikes: u32,
    /// Number of the first decision that may climb to the rung.
    open_from: u64,
}

/// A decision whose frame has not been observed.
#[derive(Clone, Copy, Debug)]
struct Predicted {
    rung: usize,
    ms: f64,
    /// Number of changes of the rung until the decision.
    changes: u64,
}

#[derive(Clone, Debug)]
pub struct Controller {
    budget: Budget,
    /// Times of the ladder's rungs.
    times_ms: Vec<f64>,
    /// Logarithms of measured over predicted time of the last frames.
    scatter: VecDeque<f64>,
    /// Logarithm of the factor by which a predicted time must stay below the budget.
    headroom: f64,
    /// The last decisions whose frames have not been observed.
    predicted: VecDeque<Predicted>,
    /// The rung of the last frame, `None` before the first.
    rung: Option<usize>,
    /// Number of changes of the rung.
    changes: u64,
    /// Measured times of the last frames that were decided on since the last change, the newest last.
    recent_ms: Vec<f64>,
    trials: Vec<Trial>,
    decisions: u64,
    /// Number of the first decision whose frames change the headroom again.
    settled_from: u64,
}

impl Controller {
    pub fn new(ladder: &Ladder, budget: Budget) -> Self {
        let times_ms: Vec<f64> = ladder.rungs().iter().map(|r| r.time_ms).collect();
        Self {
            budget,
            scatter: FIRST_SCATTER.into_iter().flat_map(|(value, count)| std::iter::repeat_n(value, count)).collect(),
            headroom: FIRST_SCATTER[1].0,
            predicted: VecDeque::with_capacity(IN_FLIGHT),
            rung: None,
            changes: 0,
            recent_ms: Vec::with_capacity(QUIET),
            trials: vec![Trial::default(); times_ms.len()],
            decisions: 0,
            settled_from: SETTLING,
            times_ms,
        }
    }

    /// Returns the factor by which a predicted time must stay below the budget.
    pub fn headroom(&self) -> f64 {
        self.headroom.exp()
    }

    fn learn_scatter(&mut self, deviation: f64) {
        if self.scatter.len() == WINDOW {
            self.scatter.pop_front();
        }
        self.scatter.push_back(deviation);
        let mut sorted: Vec<f64> = self.scatter.iter().copied().collect();
        let above = (LATE * sorted.len() as f64).ceil() as usize - 1;
        let (_, quantile, _) = sorted.select_nth_unstable_by(above, |a, b| b.total_cmp(a));
        self.headroom = quantile.clamp(0.0, MOST_HEADROOM);
    }

    /// Returns true if two of the last three frames on the current rung were late.
    fn is_overloaded(&self) -> bool {
        self.recent_ms.iter().filter(|ms| **ms > self.budget.hi_ms()).count() >= 2
    }

    /// Returns the factor by which the load has risen above predictions: 1 unless the controller is overloaded.
    fn excess(&self, predicted_ms: impl Fn(usize) -> f64) -> f64 {
        let Some(rung) = self.rung.filter(|_| self.is_overloaded()) else { return 1.0 };
        let mut recent_ms = self.recent_ms.clone();
        recent_ms.sort_by(f64::total_cmp);
        (recent_ms[recent_ms.len() / 2] / predicted_ms(rung)).clamp(1.0, RATIO_MAX)
    }

    fn choose(&self, expected_ms: impl Fn(usize) -> f64) -> usize {
        let limit_ms = self.budget.hi_ms() / self.headroom();
        let best = |rungs: std::ops::Range<usize>, limit_ms: f64| rungs.rev().find(|&r| expected_ms(r) <= limit_ms);
        let Some(rung) = self.rung else { return best(0..self.times_ms.len(), limit_ms).unwrap_or(0) };
        if expected_ms(rung) > (limit_ms * HYSTERESIS).min(self.budget.hi_ms()) {
            return best(0..rung, limit_ms).unwrap_or(0);
        }
        let is_quiet = self.recent_ms.len() == QUIET && self.recent_ms.iter().all(|ms| *ms <= self.budget.hi_ms());
        if !is_quiet {
            return rung;
        }
        // Predictions for more expensive rungs are no better than for a rung that is locked out.
        let is_locked = |r: &usize| self.trials[*r].open_from > self.decisions;
        let end = (rung + 1..self.times_ms.len()).find(is_locked).unwrap_or(self.times_ms.len());
        best(rung + 1..end, limit_ms / HYSTERESIS).unwrap_or(rung)
    }

    fn take(&mut self, chosen: usize) {
        self.decisions += 1;
        let before = self.rung.replace(chosen);
        if before != Some(chosen) {
            self.changes += 1;
            self.recent_ms.clear();
        }
        if before.is_some_and(|before| chosen > before) {
            self.trials[chosen] = Trial { climbed_at: self.decisions, ..Trial::default() };
        }
    }
}

/// Frames may finish in any order, and any number of frames after their decision. Times that are not positive and finite
/// are ignored.
impl Control for Controller {
    fn devices_changed(&mut self) {
        self.recent_ms.clear();
        self.trials.fill(Trial::default());
        self.settled_from = self.decisions + SETTLING;
    }

    fn set_budget(&mut self, budget: Budget) {
        if budget != self.budget {
            self.budget = budget;
            self.devices_changed();
        }
    }

    fn next(&mut self, predict: &dyn Fn(usize) -> f64) -> Decision {
        let times_ms = &self.times_ms;
        let predicted_ms = |rung: usize| {
            let ms = predict(rung);
            if ms.is_finite() && ms > 0.0 { ms } else { times_ms[rung] }
        };
        let excess = self.excess(predicted_ms);
        let expected_ms = |rung: usize| predicted_ms(rung) * excess;
        let chosen = self.choose(expected_ms);
        let expected_ms = expected_ms(chosen);
        self.take(chosen);
        if self.predicted.len() == IN_FLIGHT {
            self.predicted.pop_front();
        }
        self.predicted.push_back(Predicted { rung: chosen, ms: expected_ms, changes: self.changes });
        Decision { rung: chosen, expected_ms, fits: chosen > 0 || expected_ms <= self.budget.hi_ms() }
    }

    fn observe(&mut self, rung: usize, makespan_ms: f64) {
        let decided = self.predicted.iter().position(|predicted| predicted.rung == rung);
        let predicted = decided.and_then(|at| self.predicted.remove(at));
        if !(makespan_ms.is_finite() && makespan_ms > 0.0) || rung >= self.times_ms.len() {
            return;
        }
        let is_late = makespan_ms > self.budget.hi_ms();
        if let Some(predicted) = predicted.filter(|_| self.decisions > self.settled_from) {
            self.learn_scatter((makespan_ms / predicted.ms).ln());
        }
        let trial = &mut self.trials[rung];
        if is_late && self.decisions <= trial.climbed_at + LOCKED && trial.climbed_at > 0 {
            trial.strikes += 1;
            if trial.strikes >= STRIKES {
                *trial = Trial { open_from: self.decisions + LOCKED, ..Trial::default() };
            }
        }
        // A frame may be of an earlier stay on this rung.
        if self.rung == Some(rung) && predicted.is_none_or(|predicted| predicted.changes == self.changes) {
            if self.recent_ms.len() == QUIET {
                self.recent_ms.remove(0);
            }
            self.recent_ms.push(makespan_ms);
        }
    }
}
