//! How rows around a stripe come to a device.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Before which passes of a chain rows come from neighbours, for filtered rows to agree with one device's. For those in
/// between, a device filters a margin around its stripe as well, as wide as they reach together. The first pass always
/// receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HaloPlan(u32);

impl HaloPlan {
    /// Receive a wide margin once and filter it oneself.
    pub const RECOMPUTE: Self = Self(1);
    /// Receive narrow margins before every iteration.
    pub const EXCHANGE: Self = Self(u32::MAX);

    /// All plans that differ for this many passes.
    pub fn all(passes: usize) -> impl Iterator<Item = Self> {
        (0..1 << passes.saturating_sub(1)).map(|later| Self(later << 1 | 1))
    }

    pub fn receives_before(self, pass: usize) -> bool {
        self.0 >> pass & 1 == 1
    }

    /// The passes in runs, each after rows were received.
    pub fn runs(self, passes: usize) -> Vec<Range<usize>> {
        let begins = (0..passes).filter(|i| *i == 0 || self.receives_before(*i));
        let end = |begin: usize| (begin + 1..passes).find(|i| self.receives_before(*i)).unwrap_or(passes);
        begins.map(|begin| begin..end(begin)).collect()
    }
}

/// What happens where stripes meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Seam {
    /// Stripes are filtered apart.
    None,
    /// ... and smoothed across the seams afterwards.
    Filter,
    /// Filters read across: the same bytes as one device.
    Halo(HaloPlan),
}
