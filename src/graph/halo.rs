//! Treatment of the seams between stripes, and sources of the halo rows that filters read across them.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Selects the passes of a filter chain before which devices receive halo rows from their neighbours, so that filtered
/// rows match those of a single device. From one such pass to the next, a device also filters a margin around its
/// stripe that covers the combined halos of the passes in between. Rows are always received before the first pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HaloPlan(u32);

impl HaloPlan {
    /// Receives one wide halo before the first pass. Devices then filter a margin redundantly.
    pub const RECOMPUTE: Self = Self(1);
    /// Receives a narrow halo before every pass. Devices filter no margin.
    pub const EXCHANGE: Self = Self(u32::MAX);

    /// Returns all distinct plans for a chain of this many passes.
    pub fn all(passes: usize) -> impl Iterator<Item = Self> {
        (0..1 << passes.saturating_sub(1)).map(|later| Self(later << 1 | 1))
    }

    pub fn receives_before(self, pass: usize) -> bool {
        self.0 >> pass & 1 == 1
    }

    /// Returns this plan with halo rows also received before `pass`.
    pub fn receiving_before(self, pass: usize) -> Self {
        Self(self.0 | 1 << pass)
    }

    /// Splits a chain of `passes` passes into ranges of consecutive passes. Halo rows are received before each range.
    pub fn runs(self, passes: usize) -> Vec<Range<usize>> {
        let begins = (0..passes).filter(|i| *i == 0 || self.receives_before(*i));
        let end = |begin: usize| (begin + 1..passes).find(|i| self.receives_before(*i)).unwrap_or(passes);
        begins.map(|begin| begin..end(begin)).collect()
    }
}

/// Treatment of the seams between stripes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Seam {
    /// Stripes are filtered separately.
    None,
    /// Stripes are filtered separately, and smoothed across the seams afterwards.
    Filter,
    /// Filters read rows of neighbouring stripes, so that images are byte-identical to those of a single device.
    Halo(HaloPlan),
}
