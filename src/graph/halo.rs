//! Says how the rows around a stripe come to a device.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Says before which passes of a chain rows are received from neighbours, so that filtered rows agree with those of one
/// device. For the passes in between, a device also filters a margin around its stripe, as wide as these passes reach
/// together. Rows are always received before the first pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HaloPlan(u32);

impl HaloPlan {
    /// A wide margin is received once and filtered by the device itself.
    pub const RECOMPUTE: Self = Self(1);
    /// Narrow margins are received before every iteration.
    pub const EXCHANGE: Self = Self(u32::MAX);

    /// All plans that differ for a chain of this many passes.
    pub fn all(passes: usize) -> impl Iterator<Item = Self> {
        (0..1 << passes.saturating_sub(1)).map(|later| Self(later << 1 | 1))
    }

    pub fn receives_before(self, pass: usize) -> bool {
        self.0 >> pass & 1 == 1
    }

    /// This plan, with rows received before one more pass.
    pub fn receiving_before(self, pass: usize) -> Self {
        Self(self.0 | 1 << pass)
    }

    /// The passes in runs. Rows are received before each run.
    pub fn runs(self, passes: usize) -> Vec<Range<usize>> {
        let begins = (0..passes).filter(|i| *i == 0 || self.receives_before(*i));
        let end = |begin: usize| (begin + 1..passes).find(|i| self.receives_before(*i)).unwrap_or(passes);
        begins.map(|begin| begin..end(begin)).collect()
    }
}

/// Says what happens where stripes meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Seam {
    /// Stripes are filtered separately.
    None,
    /// Stripes are filtered separately, and smoothed across the seams afterwards.
    Filter,
    /// Filters read rows of neighbours, which gives the bytes of one device.
    Halo(HaloPlan),
}
