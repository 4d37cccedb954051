//! The band that frames' makespans are kept in.

use std::str::FromStr;

/// Where within the band the controller aims, as a share of the way from its lower to its upper end.
const AIM: f64 = 0.7;

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("a budget of {lo_ms} to {hi_ms} ms is none: give two times, 0 < LO < HI")]
pub struct BudgetError {
    lo_ms: f64,
    hi_ms: f64,
}

/// Makespans from `lo_ms`, below which quality is given away, to `hi_ms`, above which frames are late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    lo_ms: f64,
    hi_ms: f64,
}

/// `LO..HI`, milliseconds.
impl FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (lo, hi) = text.split_once("..").ok_or("write LO..HI, milliseconds, as 11..20")?;
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

    /// The dearest that a rung may be to be taken.
    pub fn aim_ms(&self) -> f64 {
        self.lo_ms + AIM * (self.hi_ms - self.lo_ms)
    }

    /// Half way between its ends.
    pub fn middle_ms(&self) -> f64 {
        0.5 * (self.lo_ms + self.hi_ms)
    }

    /// The dearest that a rung may be to be taken where the next cheaper one would leave the band at its lower end.
    pub fn coarse_aim_ms(&self) -> f64 {
        0.5 * (self.aim_ms() + self.hi_ms)
    }
}
