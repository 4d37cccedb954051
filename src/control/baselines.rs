//! Other controllers, which the library's own is compared with.

use std::fmt::{self, Display};
use std::str::FromStr;

use super::{Budget, Control, Controller, Decision, Ladder};

/// A controller by its name: `diptych`, `vlachos`, `unreal`, `pid`, `pinned:N` for rung N alone, or `turns:N` for N frames
/// on each rung in turn.
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
    /// Every `step`th rung for `frames` frames, from the cheapest one on, and again. Written `turns:FRAMES:STEP`.
    Turns { frames: u32, step: u32 },
}

impl ControllerKind {
    /// Returns a controller of this kind at the start of a run.
    pub fn start(self, ladder: &Ladder, budget: Budget) -> Box<dyn Control> {
        let times_ms: Vec<f64> = ladder.rungs().iter().map(|rung| rung.time_ms).collect();
        let least_ms = times_ms[0];
        let base = Base { times_ms, budget_ms: budget.hi_ms(), rung: 0 };
        match self {
            Self::Diptych => Box::new(Controller::new(ladder, budget)),
            Self::Vlachos => Box::new(Baseline { base, rule: Vlachos::default() }),
            Self::Unreal => Box::new(Baseline { base, rule: Unreal::default() }),
            Self::Pid => Box::new(Baseline { base, rule: Pid { wanted: least_ms.ln(), last: 0.0 } }),
            Self::Pinned(rung) => Box::new(Baseline { base, rule: Pinned(rung) }),
            Self::Turns { frames, step } => Box::new(Baseline { base, rule: Turns { frames, step, chosen: 0 } }),
        }
    }
}

impl FromStr for ControllerKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let of_numbers = |text: &str| -> Option<Self> {
            if let Some(rung) = text.strip_prefix("pinned:") {
                return rung.parse().ok().map(Self::Pinned);
            }
            let turns = text.strip_prefix("turns:")?;
            let (frames, step) = turns.split_once(':').unwrap_or((turns, "1"));
            let [frames, step] = [frames, step].map(|number| number.parse().ok().filter(|n| *n > 0));
            Some(Self::Turns { frames: frames?, step: step? })
        };
        match text {
            "diptych" => Ok(Self::Diptych),
            "vlachos" => Ok(Self::Vlachos),
            "unreal" => Ok(Self::Unreal),
            "pid" => Ok(Self::Pid),
            _ => of_numbers(text).ok_or_else(|| {
                "not a controller: diptych, vlachos, unreal, pid, pinned:N for rung N alone, \
                 or turns:N for N frames on each rung in turn"
                    .to_owned()
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
            Self::Turns { frames, step } => write!(f, "turns:{frames}:{step}"),
        }
    }
}

/// State that all baselines share.
struct Base {
    times_ms: Vec<f64>,
    budget_ms: f64,
    /// The current rung.
    rung: usize,
}

/// The rule of a baseline.
trait Rule: Send {
    /// Returns the rung of the next frame.
    fn choose(&mut self, base: &Base) -> usize;

    fn observe(&mut self, base: &Base, rung: usize, makespan_ms: f64);
}

/// A controller that a rule makes.
struct Baseline<R> {
    base: Base,
    rule: R,
}

impl<R: Rule> Control for Baseline<R> {
    fn next(&mut self, predict: &dyn Fn(usize) -> f64) -> Decision {
        let rung = self.rule.choose(&self.base);
        self.base.rung = rung;
        let predicted_ms = predict(rung);
        let is_known = predicted_ms.is_finite() && predicted_ms > 0.0;
        let expected_ms = if is_known { predicted_ms } else { self.base.times_ms[rung] };
        Decision { rung, expected_ms, fits: rung > 0 || expected_ms <= self.base.budget_ms }
    }

    fn observe(&mut self, rung: usize, makespan_ms: f64) {
        self.rule.observe(&self.base, rung, makespan_ms);
    }

    fn set_budget(&mut self, budget: Budget) {
        self.base.budget_ms = budget.hi_ms();
    }
}

/// Stays on its rung.
struct Pinned(usize);

impl Rule for Pinned {
    fn choose(&mut self, base: &Base) -> usize {
        self.0.min(base.times_ms.len() - 1)
    }

    fn observe(&mut self, _base: &Base, _rung: usize, _makespan_ms: f64) {}
}

/// Plays every `step`th rung for `frames` frames.
struct Turns {
    frames: u32,
    step: u32,
    /// The number of frames chosen so far.
    chosen: usize,
}

impl Rule for Turns {
    fn choose(&mut self, base: &Base) -> usize {
        let turn = self.chosen / self.frames as usize;
        self.chosen += 1;
        let rungs = base.times_ms.len().div_ceil(self.step as usize);
        turn % rungs * self.step as usize
    }

    fn observe(&mut self, _base: &Base, _rung: usize, _makespan_ms: f64) {}
}

/// Above 90 % of the budget it drops two levels, also if a linear extrapolation of the last two frames exceeds this and
/// the last took over 85 %; after three frames below 70 % it climbs one level. A change is followed by two frames
/// without decisions.
#[derive(Default)]
struct Vlachos {
    /// Times of the last frames, at most three, the newest first.
    last_ms: Vec<f64>,
    rests: usize,
}

impl Rule for Vlachos {
    fn choose(&mut self, base: &Base) -> usize {
        let rung = base.rung;
        if self.rests > 0 {
            self.rests -= 1;
            return rung;
        }
        let used: Vec<f64> = self.last_ms.iter().map(|ms| ms / base.budget_ms).collect();
        let next = match used[..] {
            [last, ..] if last > 0.9 => rung.saturating_sub(2),
            [last, before, ..] if last > 0.85 && 2.0 * last - before > 0.9 => rung.saturating_sub(2),
            [a, b, c] if a < 0.7 && b < 0.7 && c < 0.7 => (rung + 1).min(base.times_ms.len() - 1),
            _ => rung,
        };
        if next != rung {
            self.rests = 2;
        }
        next
    }

    fn observe(&mut self, _base: &Base, _rung: usize, makespan_ms: f64) {
        self.last_ms.insert(0, makespan_ms);
        self.last_ms.truncate(3);
    }
}

/// Aims at 90 % of the budget with the weighted mean of the last frames' costs, each scaled to the quality by the
/// ladder's times, changes at most every eighth frame, and drops at once after two frames over budget.
#[derive(Default)]
struct Unreal {
    /// Measured over the ladder's times of the last frames, at most 16, the newest first.
    loads: Vec<f64>,
    over: usize,
    since_change: usize,
}

impl Rule for Unreal {
    fn choose(&mut self, base: &Base) -> usize {
        let best = |load: f64| base.times_ms.iter().rposition(|ms| ms * load <= 0.9 * base.budget_ms).unwrap_or(0);
        self.since_change += 1;
        let weight = |i: usize| 0.9f64.powi(i as i32);
        let sum: f64 = (0..self.loads.len()).map(weight).sum();
        let weighted = self.loads.iter().enumerate().map(|(i, load)| load * weight(i)).sum::<f64>();
        let next = if self.over >= 2 {
            best(self.loads[0].max(self.loads[1])).min(base.rung.saturating_sub(1))
        } else if self.since_change >= 8 && self.loads.len() >= 8 {
            best(weighted / sum)
        } else {
            base.rung
        };
        if next != base.rung {
            (self.since_change, self.over) = (0, 0);
        }
        next
    }

    fn observe(&mut self, base: &Base, rung: usize, makespan_ms: f64) {
        self.loads.insert(0, makespan_ms / base.times_ms[rung]);
        self.loads.truncate(16);
        self.over = if makespan_ms > base.budget_ms { self.over + 1 } else { 0 };
    }
}

/// Aims at 75 % of the budget.
struct Pid {
    /// Logarithm of the time to ask for, on the ladder's scale.
    wanted: f64,
    last: f64,
}

impl Rule for Pid {
    fn choose(&mut self, base: &Base) -> usize {
        base.times_ms.iter().rposition(|ms| ms.ln() <= self.wanted).unwrap_or(0)
    }

    fn observe(&mut self, base: &Base, _rung: usize, makespan_ms: f64) {
        let error = (0.75 * base.budget_ms / makespan_ms).ln();
        let [least, most] = [base.times_ms[0].ln(), base.times_ms[base.times_ms.len() - 1].ln() + 0.1];
        self.wanted = (self.wanted + 0.15 * error + 0.05 * (error - self.last)).clamp(least, most);
        self.last = error;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controller_names_round_trip() {
        for name in ["diptych", "vlachos", "unreal", "pid", "pinned:3", "turns:20:1", "turns:12:3"] {
            assert_eq!(name.parse::<ControllerKind>().unwrap().to_string(), name);
        }
        assert_eq!("turns:20".parse(), Ok(ControllerKind::Turns { frames: 20, step: 1 }));
        for name in ["", "pinned", "pinned:", "pinned:-1", "Unreal", "turns", "turns:0", "turns:3:0", "turns:3:1:1"] {
            assert!(name.parse::<ControllerKind>().is_err(), "{name}");
        }
    }
}
