//! Valid ranges of a shot's numbers, in its file and in the options that override it.

use super::EXPOSURE_EV;
use crate::scene::rig::Eye;

/// Valid range of a number, and its description for messages.
pub struct Allowed {
    test: fn(f64) -> bool,
    pub what: &'static str,
}

pub const ANY: Allowed = Allowed { test: |_| true, what: "a finite number" };
pub const POSITIVE: Allowed = Allowed { test: |v| v > 0.0, what: "a number above 0" };
pub const NOT_NEGATIVE: Allowed = Allowed { test: |v| v >= 0.0, what: "0 or a number above" };
pub const YFOV: Allowed = Allowed { test: |v| (1e-6..180.0).contains(&v), what: "degrees from 1e-6 to below 180" };
pub const VIEWS: Allowed = Allowed {
    test: |v| v.fract() == 0.0 && (1.0..=Eye::MOST_VIEWS as f64).contains(&v),
    what: "a whole number from 1 to 100",
};
pub const FPS: Allowed =
    Allowed { test: |v| (1e-3..=1e6).contains(&v), what: "frames per second from 0.001 to 1000000" };
pub const DISC: Allowed = Allowed { test: |v| (0.0..90.0).contains(&v), what: "degrees from 0 to below 90" };
pub const CONE: Allowed = Allowed { test: |v| (0.0..=90.0).contains(&v), what: "degrees from 0 to 90" };
pub const STOPS: Allowed = Allowed { test: |v| EXPOSURE_EV.contains(&v), what: "stops from -24 to 24" };
pub const FRACTION: Allowed = Allowed { test: |v| (0.0..=1.0).contains(&v), what: "a number from 0 to 1" };

impl Allowed {
    /// Returns true if the value is in range and an f32 can hold it.
    pub fn allows(&self, value: f64) -> bool {
        fits_f32(value) && (self.test)(value)
    }
}

/// Returns true if an f32 can hold the value.
pub fn fits_f32(value: f64) -> bool {
    (value as f32).is_finite()
}
