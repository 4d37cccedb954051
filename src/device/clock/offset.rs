//! Tracks the offset between a device's clock and the host's, while both drift.

use std::ops::Range;

/// Maximum difference of the two clocks' rates: each crystal is within 100 ppm.
pub const MOST_DRIFT: f64 = 200e-6;

/// Offset that converts device time to host time, with its bounds, in milliseconds.
#[derive(Clone, Debug)]
pub struct Offset {
    value: f64,
    /// Bounds of `value` at the device time `at_ms`.
    bounds: Range<f64>,
    at_ms: f64,
    /// Bounds of the offset's growth, in milliseconds per millisecond of device time.
    rate: Range<f64>,
}

impl Default for Offset {
    fn default() -> Self {
        let bounds = f64::NEG_INFINITY..f64::INFINITY;
        Self { value: 0.0, bounds, at_ms: 0.0, rate: -MOST_DRIFT..MOST_DRIFT }
    }
}

impl Offset {
    /// Narrows the bounds with a measurement: `device_ms` holds the device times at which work began and ended, and
    /// `host_ms` the host times of its submission and observed completion. On the host's clock, the work cannot have
    /// begun before submission or ended after observed completion. Earlier bounds are widened by the drift since then.
    /// The offset changes only as far as the new bounds require.
    pub fn narrow(&mut self, device_ms: &Range<f64>, host_ms: &Range<f64>) {
        let lasted = (device_ms.end - device_ms.start).max(0.0);
        let bracket = host_ms.start - device_ms.start - MOST_DRIFT * lasted..host_ms.end - device_ms.end;
        let is_known = self.bounds.start.is_finite();
        // If the work took longer on the device's clock than on the host's, one of the clocks jumped meanwhile: ignore
        // the measurement, unless it is the first.
        if !(bracket.start <= bracket.end || !is_known && bracket.start.is_finite() && bracket.end.is_finite()) {
            return;
        }
        let (value, before) = self.moved_to(device_ms.end);
        let both = before.start.max(bracket.start)..before.end.min(bracket.end);
        // If the earlier and the new bounds do not overlap, one of the clocks has jumped since the last call.
        let agrees = is_known && both.start <= both.end;
        self.bounds = if agrees { both } else { bracket };
        let middle = 0.5 * (self.bounds.start + self.bounds.end);
        self.value = if agrees { value.clamp(self.bounds.start, self.bounds.end) } else { middle };
        self.at_ms = device_ms.end;
    }

    /// Returns the offset and its bounds at another device time. Assumes that the offset has changed as little as the
    /// bounds of its growth permit.
    fn moved_to(&self, device_ms: f64) -> (f64, Range<f64>) {
        let elapsed = device_ms - self.at_ms;
        let (a, b) = (self.rate.start * elapsed, self.rate.end * elapsed);
        let least = if a * b < 0.0 {
            0.0
        } else if a.abs() < b.abs() {
            a
        } else {
            b
        };
        (self.value + least, self.bounds.start + a.min(b)..self.bounds.end + a.max(b))
    }

    /// Sets the bounds of the offset's growth per millisecond.
    pub fn set_rate(&mut self, rate: Range<f64>) {
        self.rate = rate;
    }

    /// Returns the latest device time at which the offset was narrowed, and its bounds at that time.
    pub fn bounds(&self) -> (f64, Range<f64>) {
        (self.at_ms, self.bounds.clone())
    }

    /// Returns the offset expected at a device time, and its maximum error.
    pub fn at(&self, device_ms: f64) -> (f64, f64) {
        let (value, bounds) = self.moved_to(device_ms);
        (value, (value - bounds.start).abs().max((bounds.end - value).abs()))
    }

    pub fn value(&self) -> f64 {
        self.value
    }

    /// Moves the offset to the middle of its bounds.
    pub fn centre(&mut self) {
        self.value = 0.5 * (self.bounds.start + self.bounds.end);
    }

    /// Returns the maximum error of the offset.
    pub fn error_ms(&self) -> f64 {
        (self.value - self.bounds.start).abs().max((self.bounds.end - self.value).abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device whose clock runs at a different rate than the host's.
    struct Fake {
        rate: f64,
        /// Device time at host time 0.
        begin_ms: f64,
        random: u32,
    }

    impl Fake {
        fn new(ppm: f64) -> Self {
            Self { rate: 1.0 + ppm * 1e-6, begin_ms: 7.5e8, random: 1 }
        }

        fn device_ms(&self, host_ms: f64) -> f64 {
            self.begin_ms + host_ms * self.rate
        }

        /// Returns a pseudo-random delay from 0 to `most_ms`.
        fn delay_ms(&mut self, most_ms: f64) -> f64 {
            self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.random) / f64::from(u32::MAX) * most_ms
        }

        /// Simulates 8 ms of work that is submitted at `host_ms`. Its begin and its observed completion are each late
        /// by at most `delay_ms`. Returns the error of the offset, in milliseconds, at the end of the work.
        fn frame(&mut self, offset: &mut Offset, host_ms: f64, delay_ms: f64) -> f64 {
            let begin_ms = host_ms + 0.01 + self.delay_ms(delay_ms);
            let end_ms = begin_ms + 8.0;
            let seen_ms = end_ms + 0.02 + self.delay_ms(delay_ms);
            let device_ms = self.device_ms(begin_ms)..self.device_ms(end_ms);
            offset.narrow(&device_ms, &(host_ms..seen_ms));
            (device_ms.end + offset.value() - end_ms).abs()
        }
    }

    /// Ten minutes of frames, in which 50 ppm amount to 30 ms.
    #[test]
    fn drift_is_followed_within_the_bounds() {
        for ppm in [-50.0, -20.0, 0.0, 20.0, 50.0] {
            let (mut fake, mut offset) = (Fake::new(ppm), Offset::default());
            for frame in 0..54_000 {
                let wrong_ms = fake.frame(&mut offset, f64::from(frame) * 11.0, 0.3);
                assert!(wrong_ms <= offset.error_ms() + 1e-6, "{ppm} ppm, frame {frame}: {wrong_ms} ms");
                assert!(offset.error_ms() < 0.7, "{ppm} ppm, frame {frame}: {} ms", offset.error_ms());
                assert!(frame < 1000 || wrong_ms < 0.25, "{ppm} ppm, frame {frame}: {wrong_ms} ms");
            }
        }
    }

    /// A tight bound stays tight unless a measurement contradicts it.
    #[test]
    fn loose_brackets_keep_a_tight_offset() {
        let (mut fake, mut offset) = (Fake::new(0.0), Offset::default());
        fake.frame(&mut offset, 0.0, 0.0);
        let before = offset.value();
        for frame in 1..1000 {
            fake.frame(&mut offset, f64::from(frame) * 100.0, 20.0);
        }
        assert_eq!(offset.value(), before);
    }

    /// A device's clock may restart after sleep, and the host's clock may have stopped.
    #[test]
    fn jumps_are_followed_at_once() {
        for jump_ms in [-3_600_000.0, -5.0, 5.0, 3_600_000.0] {
            let (mut fake, mut offset) = (Fake::new(20.0), Offset::default());
            for frame in 0..100 {
                fake.frame(&mut offset, f64::from(frame) * 11.0, 0.3);
            }
            fake.begin_ms += jump_ms;
            let wrong_ms = fake.frame(&mut offset, 1200.0, 0.3);
            assert!(wrong_ms <= offset.error_ms() + 1e-6 && wrong_ms < 0.4, "{jump_ms} ms: {wrong_ms}");
        }
    }

    #[test]
    fn contradictory_brackets_count_only_at_the_start() {
        let mut offset = Offset::default();
        offset.narrow(&(f64::NAN..1.0), &(0.0..1.0));
        assert_eq!(offset.value(), 0.0);
        offset.narrow(&(100.0..130.0), &(1100.0..1110.0));
        assert!((offset.value() - 990.0).abs() < 0.1, "{}", offset.value());
        let before = offset.value();
        offset.narrow(&(200.0..230.0), &(1500.0..1510.0));
        assert_eq!(offset.value(), before);
    }
}
