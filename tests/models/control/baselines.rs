//! Other controllers, for comparison.

use super::recorded::Recording;
use super::replay::Choose;

/// Always the same rung.
pub struct Pinned(pub usize);

impl Choose for Pinned {
    fn next(&mut self, _predictor: &dyn Fn(usize) -> f64) -> usize {
        self.0
    }

    fn observe(&mut self, _rung: usize, _ms: f64) {}
}

/// The adaptive quality of Vlachos 2016, "Advanced VR Rendering Performance", GDC: above 90 % of the budget it drops
/// two levels, or one if a linear extrapolation of the last two frames exceeds 85 %; after three frames below 70 % it
/// climbs one level. A change is followed by two frames without decisions.
pub struct Vlachos {
    rungs: usize,
    rung: usize,
    budget_ms: f64,
    last_ms: Vec<f64>,
    rests: usize,
}

impl Vlachos {
    pub fn new(recording: &Recording, budget_ms: f64) -> Self {
        Self { rungs: recording.ladder.rungs().len(), rung: 0, budget_ms, last_ms: Vec::new(), rests: 0 }
    }
}

impl Choose for Vlachos {
    fn next(&mut self, _predictor: &dyn Fn(usize) -> f64) -> usize {
        if self.rests > 0 {
            self.rests -= 1;
            return self.rung;
        }
        let used: Vec<f64> = self.last_ms.iter().rev().take(3).map(|ms| ms / self.budget_ms).collect();
        let before = self.rung;
        match used[..] {
            [last, ..] if last > 0.9 => self.rung = self.rung.saturating_sub(2),
            [last, before, ..] if last > 0.85 && 2.0 * last - before > 0.9 => self.rung = self.rung.saturating_sub(2),
            [a, b, c] if a < 0.7 && b < 0.7 && c < 0.7 => self.rung = (self.rung + 1).min(self.rungs - 1),
            _ => {}
        }
        if self.rung != before {
            self.rests = 2;
        }
        self.rung
    }

    fn observe(&mut self, _rung: usize, ms: f64) {
        self.last_ms.push(ms);
    }

    fn set_budget(&mut self, hi_ms: f64) {
        self.budget_ms = hi_ms;
    }
}

/// Dynamic resolution as in Unreal Engine 5: aims at 90 % of the budget with the weighted mean of the last frames'
/// costs, each scaled to the quality by the ladder's times, changes at most every eighth frame, and drops at once after
/// two frames over budget.
pub struct Unreal {
    times_ms: Vec<f64>,
    rung: usize,
    budget_ms: f64,
    /// Measured over the ladder's times.
    loads: Vec<f64>,
    over: usize,
    since_change: usize,
}

impl Unreal {
    pub fn new(recording: &Recording, budget_ms: f64) -> Self {
        let times_ms = recording.ladder.rungs().iter().map(|r| r.time_ms).collect();
        Self { times_ms, rung: 0, budget_ms, loads: Vec::new(), over: 0, since_change: 0 }
    }

    fn best(&self, load: f64) -> usize {
        self.times_ms.iter().rposition(|ms| ms * load <= 0.9 * self.budget_ms).unwrap_or(0)
    }
}

impl Choose for Unreal {
    fn next(&mut self, _predictor: &dyn Fn(usize) -> f64) -> usize {
        self.since_change += 1;
        let last: Vec<f64> = self.loads.iter().rev().take(16).copied().collect();
        let weight = |i: usize| 0.9f64.powi(i as i32);
        let sum: f64 = (0..last.len()).map(weight).sum();
        let mean = last.iter().enumerate().map(|(i, load)| load * weight(i)).sum::<f64>() / sum.max(1e-9);
        let before = self.rung;
        if self.over >= 2 {
            self.rung = self.best(last[0].max(last[1])).min(self.rung.saturating_sub(1));
        } else if self.since_change >= 8 && last.len() >= 8 {
            self.rung = self.best(mean);
        }
        if self.rung != before {
            (self.since_change, self.over) = (0, 0);
        }
        self.rung
    }

    fn observe(&mut self, rung: usize, ms: f64) {
        self.loads.push(ms / self.times_ms[rung]);
        self.over = if ms > self.budget_ms { self.over + 1 } else { 0 };
    }

    fn set_budget(&mut self, hi_ms: f64) {
        self.budget_ms = hi_ms;
    }
}

/// A PID controller on the logarithm of frame time, aiming at 75 % of the budget.
pub struct Pid {
    times_ms: Vec<f64>,
    budget_ms: f64,
    /// Logarithm of the time to ask for, on the ladder's scale.
    wanted: f64,
    last: f64,
}

impl Pid {
    pub fn new(recording: &Recording, budget_ms: f64) -> Self {
        let times_ms: Vec<f64> = recording.ladder.rungs().iter().map(|r| r.time_ms).collect();
        Self { wanted: times_ms[0].ln(), times_ms, budget_ms, last: 0.0 }
    }
}

impl Choose for Pid {
    fn next(&mut self, _predictor: &dyn Fn(usize) -> f64) -> usize {
        self.times_ms.iter().rposition(|ms| ms.ln() <= self.wanted).unwrap_or(0)
    }

    fn observe(&mut self, _rung: usize, ms: f64) {
        let error = (0.75 * self.budget_ms / ms).ln();
        let bounds = [self.times_ms[0].ln(), self.times_ms[self.times_ms.len() - 1].ln() + 0.1];
        self.wanted = (self.wanted + 0.15 * error + 0.05 * (error - self.last)).clamp(bounds[0], bounds[1]);
        self.last = error;
    }

    fn set_budget(&mut self, hi_ms: f64) {
        self.budget_ms = hi_ms;
    }
}
