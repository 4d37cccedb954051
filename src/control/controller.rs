//! Picks the rung of the next frame.
//!
//! The target is the most expensive rung that is predicted to stay inside the band, with headroom for the scatter of
//! frames. Above the band the controller drops straight to the target, below the band it jumps straight up to it, and
//! within the band it climbs one rung at a time. If no rung fits with headroom, a rung just inside the band is better
//! than one below it. The expected time is the prediction times the learned correction factor ([`super::correction`]).

use super::correction::Correction;
use super::{Budget, Ladder};

/// Minimum number of frames after a change of rung or devices before the controller climbs to a more expensive rung.
pub const CLIMB_EVERY: u32 = 8;
/// Minimum number of frames after such a change before the controller climbs from a rung that is below the band. It is
/// smaller, since a drop after a burst of load may have gone too far.
pub const CLIMB_BACK_AFTER: u32 = 4;
/// Number of frames after a climb within which a drop marks the climb as a mistake.
const PROBATION: u32 = 16;
/// Number of frames for which a rung is locked out after the first such mistake, and the maximum of this number. Each
/// further mistake doubles the number.
const RETRY_AFTER: [u32; 2] = [32, 1024];
/// Ratio of the times of two neighbouring rungs above which a step up needs less headroom.
const COARSE: f64 = 1.3;
/// Maximum of the margin for the scatter of frame times, a factor (see [`Correction::margin`]).
const MARGIN_MAX: f64 = 1.2;

/// Predicts frame times.
pub trait Predict {
    /// Predicts the makespan of the next frame on this rung, in ms. The ladder's own measurement replaces any value
    /// that is not positive and finite.
    fn makespan_ms(&self, rung: usize) -> f64;
}

impl<F: Fn(usize) -> f64> Predict for F {
    fn makespan_ms(&self, rung: usize) -> f64 {
        self(rung)
    }
}

/// The choice of the next frame's rung.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Index into the ladder's rungs.
    pub rung: usize,
    /// The corrected prediction of the frame's makespan.
    pub expected_ms: f64,
    /// False if no rung is expected to stay within the budget. The rung is then the cheapest.
    pub fits: bool,
}

/// Lock-out state of a rung, from the outcome of earlier climbs to it.
#[derive(Clone, Debug)]
struct Trial {
    /// Number of the first decision that may climb to the rung.
    from: u64,
    /// Number of decisions for which the next mistake locks the rung out.
    retry_after: u32,
}

#[derive(Clone, Debug)]
pub struct Controller {
    budget: Budget,
    /// Times of the ladder's rungs.
    times_ms: Vec<f64>,
    correction: Correction,
    /// The rung of the last frame, `None` before the first.
    rung: Option<usize>,
    decisions: u64,
    changed_at: u64,
    /// Rung of the last climb and the number of that decision, while the climb is on probation.
    climbed: Option<(usize, u64)>,
    trials: Vec<Trial>,
}

impl Controller {
    pub fn new(ladder: &Ladder, budget: Budget) -> Self {
        let times_ms: Vec<f64> = ladder.rungs().iter().map(|r| r.time_ms).collect();
        let trials = vec![Trial { from: 0, retry_after: RETRY_AFTER[0] }; times_ms.len()];
        let correction = Correction::default();
        Self { budget, times_ms, correction, rung: None, decisions: 0, changed_at: 0, climbed: None, trials }
    }

    /// Adds the makespan of a finished frame. Frames may finish in any order, and any number of frames after their
    /// decision. Times that are not positive and finite are ignored.
    pub fn observe(&mut self, rung: usize, makespan_ms: f64) {
        if makespan_ms.is_finite() && makespan_ms > 0.0 {
            self.correction.learn(rung.min(self.times_ms.len() - 1), makespan_ms);
        }
    }

    /// Adapts to devices that were added, removed or changed in speed. The last frames then do not predict the next
    /// ones, but the correction factor still holds.
    pub fn devices_changed(&mut self) {
        self.correction.forget_frames();
        self.changed_at = self.decisions;
        self.climbed = None;
    }

    /// Picks the rung of the next frame. It calls `predictor` at most a few times per rung, and not at all for most
    /// rungs.
    pub fn next(&mut self, predictor: &impl Predict) -> Decision {
        let times_ms = &self.times_ms;
        let predicted_ms = |rung: usize| {
            let ms = predictor.makespan_ms(rung);
            if ms.is_finite() && ms > 0.0 { ms } else { times_ms[rung] }
        };
        self.correction.update(predicted_ms);
        let factor = self.correction.factor();
        let expected_ms = |rung: usize| predicted_ms(rung) * factor;
        let chosen = self.choose(expected_ms);
        let expected_ms = expected_ms(chosen);
        self.take(chosen);
        Decision { rung: chosen, expected_ms, fits: chosen > 0 || expected_ms <= self.budget.hi_ms() }
    }

    fn choose(&self, expected_ms: impl Fn(usize) -> f64) -> usize {
        let margin = self.correction.margin().min(MARGIN_MAX);
        let limits = Limits {
            lo_ms: self.budget.lo_ms(),
            reach_ms: self.budget.reach_ms(margin),
            gap_reach_ms: self.budget.gap_reach_ms(margin),
        };
        let rungs = self.times_ms.len();
        let Some(rung) = self.rung else { return limits.most_expensive(0..rungs, expected_ms).unwrap_or(0) };
        let now_ms = expected_ms(rung);
        if now_ms > self.budget.hi_ms() / margin {
            let lower = limits.most_expensive(0..rung, &expected_ms).unwrap_or(0);
            // A rung that sometimes exceeds the budget is better than one that is never within the band.
            let is_held = now_ms <= self.budget.hi_ms() && expected_ms(lower) < limits.lo_ms;
            return if is_held { rung } else { lower };
        }
        let wait = if now_ms < limits.lo_ms { CLIMB_BACK_AFTER } else { CLIMB_EVERY };
        if self.decisions - self.changed_at < u64::from(wait) {
            return rung;
        }
        let may_climb_to = |r: &usize| self.decisions >= self.trials[*r].from;
        let mut above = rung + 1..rungs;
        let higher = if now_ms < limits.lo_ms {
            // Predictions for more expensive rungs are no better than for the rung that turned out to be a mistake.
            let end = above.find(|r| !may_climb_to(r) || expected_ms(*r) > limits.gap_reach_ms).unwrap_or(rungs);
            limits.most_expensive(rung + 1..end, &expected_ms)
        } else {
            let is_step = rung + 1 < rungs && expected_ms(rung + 1) > COARSE * now_ms;
            let reach_ms = if is_step { self.budget.step_reach_ms(margin) } else { limits.reach_ms };
            above.find(|&r| expected_ms(r) <= reach_ms).filter(may_climb_to)
        };
        higher.unwrap_or(rung)
    }

    /// Records the chosen rung. If it is a drop within the probation of a climb, locks out the rung of that climb.
    fn take(&mut self, chosen: usize) {
        let now = self.decisions;
        self.decisions += 1;
        if let Some((rung, at)) = self.climbed {
            let trial = &mut self.trials[rung];
            if now - at > u64::from(PROBATION) {
                trial.retry_after = RETRY_AFTER[0];
                self.climbed = None;
            } else if chosen < rung {
                trial.from = now + u64::from(trial.retry_after);
                trial.retry_after = (2 * trial.retry_after).min(RETRY_AFTER[1]);
                self.climbed = None;
            }
        }
        let Some(before) = self.rung.replace(chosen) else { return };
        if chosen != before {
            self.changed_at = now;
        }
        if chosen > before {
            self.climbed = Some((chosen, now));
        }
    }
}

/// Bounds on the expected time of rungs that may be chosen.
struct Limits {
    lo_ms: f64,
    /// Results of [`Budget::reach_ms`] and [`Budget::gap_reach_ms`] for the current scatter.
    reach_ms: f64,
    gap_reach_ms: f64,
}

impl Limits {
    /// Returns the most expensive of these rungs, which are in ascending order, within `reach_ms`. If that rung is
    /// below the band, or no rung is within reach, returns the next more expensive one if it is within `gap_reach_ms`.
    fn most_expensive(
        &self,
        rungs: impl DoubleEndedIterator<Item = usize>,
        expected_ms: impl Fn(usize) -> f64,
    ) -> Option<usize> {
        let mut next = None;
        for rung in rungs.rev() {
            let ms = expected_ms(rung);
            if ms <= self.reach_ms {
                return if ms < self.lo_ms { next.or(Some(rung)) } else { Some(rung) };
            }
            next = (ms <= self.gap_reach_ms).then_some(rung);
        }
        next
    }
}
