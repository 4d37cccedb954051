//! The band in which the controller keeps the makespans of frames.

use std::str::FromStr;

/// Headroom for a change to a rung: the product of the rung's expected time, the scatter margin and this factor must be
/// at most the band's upper end. The current rung is kept without this factor; this hysteresis prevents oscillation.
const HEADROOM: f64 = 1.15;
/// Headroom for a step to a much more expensive rung. It is smaller than [`HEADROOM`], with which frames would leave a
/// good part of the band unused.
const STEP_HEADROOM: f64 = 1.06;
/// Headroom for a rung above a gap, where all cheaper rungs are below the band.
const GAP_HEADROOM: f64 = 1.03;

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{lo_ms} to {hi_ms} ms is not a valid frame budget: give two times, 0 < LO < HI")]
pub struct BudgetError {
    lo_ms: f64,
    hi_ms: f64,
}

/// Makespans from `lo_ms`, below which quality is wasted, to `hi_ms`, above which frames miss their deadline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    lo_ms: f64,
    hi_ms: f64,
}

/// Parses `LO..HI`, in milliseconds.
impl FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (lo, hi) = text.split_once("..").ok_or("write LO..HI in milliseconds, e.g. 11..20")?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| format!("'{text}' is not a time in ms"));
        Self::new(number(lo)?, number(hi)?).map_err(|e| e.to_string())
    }
}

impl Budget {
    /// # Errors
    /// [`BudgetError`] unless 0 < `lo_ms` < `hi_ms`, both finite.
    pub fn new(lo_ms: f64, hi_ms: f64) -> Result<Self, BudgetError> {
        let is_band = lo_ms > 0.0 && lo_ms < hi_ms && hi_ms.is_finite();
        if is_band { Ok(Self { lo_ms, hi_ms }) } else { Err(BudgetError { lo_ms, hi_ms }) }
    }

    pub fn lo_ms(&self) -> f64 {
        self.lo_ms
    }

    pub fn hi_ms(&self) -> f64 {
        self.hi_ms
    }

    /// Returns the largest expected time, in milliseconds, at which the controller changes to a rung. `margin` is 1 +
    /// the relative standard deviation of frame times. The result is at least the middle of the band: a lower target
    /// would trade missed deadlines for wasted quality.
    pub fn reach_ms(&self, margin: f64) -> f64 {
        self.below_end_ms(HEADROOM * margin)
    }

    /// Returns the limit of [`Self::reach_ms`] with less headroom, for a step to a rung that is much more expensive
    /// than the current one.
    pub fn step_reach_ms(&self, margin: f64) -> f64 {
        self.below_end_ms(STEP_HEADROOM * margin)
    }

    /// Returns the limit of [`Self::reach_ms`] with less headroom, for a rung above a gap, where all cheaper rungs are
    /// below the band. Half a standard deviation of margin is enough there, since frames of the cheaper rungs would all
    /// miss the band.
    pub fn gap_reach_ms(&self, margin: f64) -> f64 {
        self.below_end_ms(GAP_HEADROOM * margin.sqrt())
    }

    fn below_end_ms(&self, times: f64) -> f64 {
        (self.hi_ms / times).max(0.5 * (self.lo_ms + self.hi_ms))
    }
}
