//! Other controllers, which the library's own is compared with.

use std::fmt::{self, Display};
use std::str::FromStr;

use super::{Budget, Control, Controller, Decision, Ladder, Predict};

/// A controller by its name: `diptych`, `vlachos`, `unreal`, `pid`, or `pinned:N` for rung N alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ControllerKind {
    /// [`Controller`].
    #[default]
    Diptych,
    /// The adaptive quality of Vlachos, "Advanced VR Rendering Performance", GDC 2016.
    Vlachos,
    /// Dynamic resolution as in Unreal Engine 5.
    Unreal,
    /// A PID controller on the logarithm of frame time.
    Pid,
    /// Always the same rung, or the highest one if there are fewer.
    Pinned(usize),
}

impl ControllerKind {
    /// Returns a controller of this kind at the start of a run.
    pub fn start(self, ladder: &Ladder, budget: Budget) -> Box<dyn Control> {
        let base = Base::new(ladder, budget);
        match self {
            Self::Diptych => Box::new(Controller::new(ladder, budget)),
            Self::Vlachos => Box::new(Vlachos { base, last_ms: Vec::new(), rests: 0 }),
            Self::Unreal => Box::new(Unreal { base, loads: Vec::new(), over: 0, since_change: 0 }),
            Self::Pid => Box::new(Pid { wanted: base.times_ms[0].ln(), base, last: 0.0 }),
            Self::Pinned(rung) => Box::new(Pinned { base: Base { rung: rung.min(base.times_ms.len() - 1), ..base } }),
        }
    }
}

impl FromStr for ControllerKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pinned = |text: &str| text.strip_prefix("pinned:")?.parse().ok();
        match text {
            "diptych" => Ok(Self::Diptych),
            "vlachos" => Ok(Self::Vlachos),
            "unreal" => Ok(Self::Unreal),
            "pid" => Ok(Self::Pid),
            _ => pinned(text).map(Self::Pinned).ok_or_else(|| {
                "not a controller: diptych, vlachos, unreal, pid, or pinned:N for rung N alone".to_owned()
            }),
        }
    }
}

impl Display for ControllerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Diptych => f.write_str("diptych"),
            Self::Vlachos => f.write_str("vlachos"),
            Self::Unreal => f.write_str("unreal"),
            Self::Pid => f.write_str("pid"),
            Self::Pinned(rung) => write!(f, "pinned:{rung}"),
        }
    }
}

/// The state that all these controllers have.
struct Base {
    times_ms: Vec<f64>,
    budget_ms: f64,
    rung: usize,
}

impl Base {
    fn new(ladder: &Ladder, budget: Budget) -> Self {
        let times_ms = ladder.rungs().iter().map(|rung| rung.time_ms).collect();
        Self { times_ms, budget_ms: budget.hi_ms(), rung: 0 }
    }

    fn decision(&self, predictor: &dyn Predict) -> Decision {
        let predicted_ms = predictor.makespan_ms(self.rung);
        let is_known = predicted_ms.is_finite() && predicted_ms > 0.0;
        let expected_ms = if is_known { predicted_ms } else { self.times_ms[self.rung] };
        Decision { rung: self.rung, expected_ms, fits: self.rung > 0 || expected_ms <= self.budget_ms }
    }
}

struct Pinned {
    base: Base,
}

impl Control for Pinned {
    fn next(&mut self, predictor: &dyn Predict) -> Decision {
        self.base.decision(predictor)
    }

    fn observe(&mut self, _rung: usize, _makespan_ms: f64) {}

    fn set_budget(&mut self, budget: Budget) {
        self.base.budget_ms = budget.hi_ms();
    }
}

/// Above 90 % of the budget it drops two levels, also if a linear extrapolation of the last two frames exceeds this and
/// the last took over 85 %; after three frames below 70 % it climbs one level. A change is followed by two frames
/// without decisions.
struct Vlachos {
    base: Base,
    /// Times of the last frames, at most three, the newest first.
    last_ms: Vec<f64>,
    rests: usize,
}

impl Control for Vlachos {
    fn next(&mut self, predictor: &dyn Predict) -> Decision {
        if self.rests > 0 {
            self.rests -= 1;
            return self.base.decision(predictor);
        }
        let used: Vec<f64> = self.last_ms.iter().map(|ms| ms / self.base.budget_ms).collect();
        let Base { rung, ref times_ms, .. } = self.base;
        let next = match used[..] {
            [last, ..] if last > 0.9 => rung.saturating_sub(2),
            [last, before, ..] if last > 0.85 && 2.0 * last - before > 0.9 => rung.saturating_sub(2),
            [a, b, c] if a < 0.7 && b < 0.7 && c < 0.7 => (rung + 1).min(times_ms.len() - 1),
            _ => rung,
        };
        if next != rung {
            (self.base.rung, self.rests) = (next, 2);
        }
        self.base.decision(predictor)
    }

    fn observe(&mut self, _rung: usize, makespan_ms: f64) {
        self.last_ms.insert(0, makespan_ms);
        self.last_ms.truncate(3);
    }

    fn set_budget(&mut self, budget: Budget) {
        self.base.budget_ms = budget.hi_ms();
    }
}

/// Aims at 90 % of the budget with the weighted mean of the last frames' costs, each scaled to the quality by the
/// ladder's times, changes at most every eighth frame, and drops at once after two frames over budget.
struct Unreal {
    base: Base,
    /// Measured over the ladder's times of the last frames, at most 16, the newest first.
    loads: Vec<f64>,
    over: usize,
    since_change: usize,
}

impl Unreal {
    fn best(&self, load: f64) -> usize {
        self.base.times_ms.iter().rposition(|ms| ms * load <= 0.9 * self.base.budget_ms).unwrap_or(0)
    }
}

impl Control for Unreal {
    fn next(&mut self, predictor: &dyn Predict) -> Decision {
        self.since_change += 1;
        let weight = |i: usize| 0.9f64.powi(i as i32);
        let sum: f64 = (0..self.loads.len()).map(weight).sum();
        let weighted = self.loads.iter().enumerate().map(|(i, load)| load * weight(i)).sum::<f64>();
        let before = self.base.rung;
        if self.over >= 2 {
            self.base.rung = self.best(self.loads[0].max(self.loads[1])).min(before.saturating_sub(1));
        } else if self.since_change >= 8 && self.loads.len() >= 8 {
            self.base.rung = self.best(weighted / sum);
        }
        if self.base.rung != before {
            (self.since_change, self.over) = (0, 0);
        }
        self.base.decision(predictor)
    }

    fn observe(&mut self, rung: usize, makespan_ms: f64) {
        self.loads.insert(0, makespan_ms / self.base.times_ms[rung]);
        self.loads.truncate(16);
        self.over = if makespan_ms > self.base.budget_ms { self.over + 1 } else { 0 };
    }

    fn set_budget(&mut self, budget: Budget) {
        self.base.budget_ms = budget.hi_ms();
    }
}

/// Aims at 75 % of the budget.
struct Pid {
    base: Base,
    /// Logarithm of the time to ask for, on the ladder's scale.
    wanted: f64,
    last: f64,
}

impl Control for Pid {
    fn next(&mut self, predictor: &dyn Predict) -> Decision {
        self.base.rung = self.base.times_ms.iter().rposition(|ms| ms.ln() <= self.wanted).unwrap_or(0);
        self.base.decision(predictor)
    }

    fn observe(&mut self, _rung: usize, makespan_ms: f64) {
        let error = (0.75 * self.base.budget_ms / makespan_ms).ln();
        let times_ms = &self.base.times_ms;
        let [least, most] = [times_ms[0].ln(), times_ms[times_ms.len() - 1].ln() + 0.1];
        self.wanted = (self.wanted + 0.15 * error + 0.05 * (error - self.last)).clamp(least, most);
        self.last = error;
    }

    fn set_budget(&mut self, budget: Budget) {
        self.base.budget_ms = budget.hi_ms();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_controllers_are_read_as_they_are_written() {
        for name in ["diptych", "vlachos", "unreal", "pid", "pinned:3"] {
            assert_eq!(name.parse::<ControllerKind>().unwrap().to_string(), name);
        }
        for name in ["", "pinned", "pinned:", "pinned:-1", "Unreal"] {
            assert!(name.parse::<ControllerKind>().is_err(), "{name}");
        }
    }
}
