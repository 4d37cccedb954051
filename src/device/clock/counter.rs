//! Unwraps device timestamps. Drivers have counters of 36 to 64 bits, and wgpu does not report the width.

/// Period of a 36-bit counter. wgpu offers no timestamps on narrower counters.
const LEAST_PERIOD: u64 = 1 << 36;

/// Converts a counter that wraps around to one that does not.
#[derive(Clone, Debug, Default)]
pub struct Counter {
    first: Option<u64>,
    /// First tick of the previous call.
    last: u64,
    most: u64,
    /// Ticks lost to wraparound so far.
    lost: u64,
}

impl Counter {
    /// Converts counter values to ticks since the first value of the first call. `ticks` must be in order of time,
    /// except that values of overlapping passes may be swapped.
    pub fn elapsed(&mut self, ticks: &[u64]) -> Vec<f64> {
        let Some(&first) = ticks.first() else { return Vec::new() };
        let start = *self.first.get_or_insert(first);
        self.most = ticks.iter().copied().fold(self.most, u64::max);
        self.lost = self.lost.wrapping_add(self.lost_between(self.last, first));
        self.last = first;
        let since = |tick: u64| tick.wrapping_add(self.lost).wrapping_add(self.lost_between(first, tick));
        ticks.iter().map(|&tick| since(tick).wrapping_sub(start).cast_signed() as f64).collect()
    }

    /// Returns the counter's period if the counter wrapped around between `before` and `tick`, that is, if it fell by
    /// more than half a period; otherwise 0. The period is the smallest power of two above all ticks so far, at least
    /// [`LEAST_PERIOD`]: just before it wraps, a counter is close to its period.
    fn lost_between(&self, before: u64, tick: u64) -> u64 {
        let period = self.most.checked_add(1).and_then(u64::checked_next_power_of_two).unwrap_or(0);
        let period = if period == 0 { 0 } else { period.max(LEAST_PERIOD) };
        if period > 0 && before.saturating_sub(tick) > period / 2 { period } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a counter with this many bits in groups of four ticks, `step` apart.
    fn assert_goes_on(bits: u32, begin: u64, step: u64, groups: u64) {
        let mut counter = Counter::default();
        let period = 1u128 << bits;
        for group in 0..groups {
            let times: Vec<u64> = (0..4).map(|i| (4 * group + i) * step).collect();
            let ticks: Vec<u64> =
                times.iter().map(|t| ((u128::from(begin) + u128::from(*t)) % period) as u64).collect();
            let expected: Vec<f64> = times.iter().map(|&t| t as f64).collect();
            assert_eq!(counter.elapsed(&ticks), expected, "{bits} bits, group {group}");
        }
    }

    #[test]
    fn counters_of_any_width_go_on() {
        for bits in [36, 40, 48, 56] {
            let period = 1u64 << bits;
            assert_goes_on(bits, period - 10, 3, 20);
            assert_goes_on(bits, period - period / 8, period / 100, 400);
        }
        assert_goes_on(64, u64::MAX - 1000, 3, 20);
        assert_goes_on(36, 17, 1 << 20, 100_000);
    }

    #[test]
    fn overlapping_passes_keep_places_across_wraparound() {
        let mut counter = Counter::default();
        let end = (1 << 36) - 1;
        assert_eq!(counter.elapsed(&[end - 9, 2, end - 1, 5]), [0.0, 12.0, 8.0, 15.0]);
        assert_eq!(counter.elapsed(&[7, 6, 10]), [17.0, 16.0, 20.0]);
    }

    #[test]
    fn small_steps_back_are_no_new_beginning() {
        let mut counter = Counter::default();
        assert_eq!(counter.elapsed(&[1 << 40]), [0.0]);
        assert_eq!(counter.elapsed(&[(1 << 40) - (1 << 38)]), [-((1u64 << 38) as f64)]);
        assert_eq!(counter.elapsed(&[]), [0.0; 0]);
    }
}
