//! The band in which the controller keeps the makespans of frames.

use std::str::FromStr;

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
}
