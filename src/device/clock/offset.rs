//! How far a device's clock is from the host's, while both drift.

use std::ops::Range;

/// By how much the two clocks' rates differ at most: each one's crystal is within 100 ppm.
pub const MOST_DRIFT: f64 = 200e-6;

/// What is added to times of the device to have the host's, and the bounds of it. All are milliseconds.
#[derive(Clone, Debug)]
pub struct Offset {
    value: f64,
    /// What `value` lies within, at a time of the device.
    bounds: Range<f64>,
    at_ms: f64,
    /// It grows by no less and no more each millisecond.
    rate: Range<f64>,
}

impl Default for Offset {
    fn default() -> Self {
        let bounds = f64::NEG_INFINITY..f64::INFINITY;
        Self { value: 0.0, bounds, at_ms: 0.0, rate: -MOST_DRIFT..MOST_DRIFT }
    }
}

impl Offset {
    /// Learns from work that was between two times of the device and was handed out and seen to have ended at two times
    /// of the host: it can have neither begun before the one nor ended after the other. What was known before may have
    /// drifted away since. The offset moves no more than it must.
    pub fn narrow(&mut self, device_ms: &Range<f64>, host_ms: &Range<f64>) {
        let lasted = (device_ms.end - device_ms.start).max(0.0);
        let bracket = host_ms.start - device_ms.start - MOST_DRIFT * lasted..host_ms.end - device_ms.end;
        let is_known = self.bounds.start.is_finite();
        // Longer on the device's clock than on the host's: one of them has jumped on the way.
        if !(bracket.start <= bracket.end || !is_known && bracket.start.is_finite() && bracket.end.is_finite()) {
            return;
        }
        let (value, before) = self.moved_to(device_ms.end);
        let both = before.start.max(bracket.start)..before.end.min(bracket.end);
        // Else one of the clocks has jumped in between.
        let agrees = is_known && both.start <= both.end;
        self.bounds = if agrees { both } else { bracket };
        let middle = 0.5 * (self.bounds.start + self.bounds.end);
        self.value = if agrees { value.clamp(self.bounds.start, self.bounds.end) } else { middle };
        self.at_ms = device_ms.end;
    }

    /// The offset and its bounds at another time of the device. It is taken to grow as little as it may.
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

    /// What is known of how fast it grows: by no less and no more each millisecond.
    pub fn set_rate(&mut self, rate: Range<f64>) {
        self.rate = rate;
    }

    /// What it lay within at the latest time of the device at which it was narrowed; that time comes first.
    pub fn bounds(&self) -> (f64, Range<f64>) {
        (self.at_ms, self.bounds.clone())
    }

    /// What it is expected to be at a time of the device, and how wrong that is at most.
    pub fn at(&self, device_ms: f64) -> (f64, f64) {
        let (value, bounds) = self.moved_to(device_ms);
        (value, (value - bounds.start).abs().max((bounds.end - value).abs()))
    }

    pub fn value(&self) -> f64 {
        self.value
    }

    /// Takes the middle between the bounds.
    pub fn centre(&mut self) {
        self.value = 0.5 * (self.bounds.start + self.bounds.end);
    }

    /// How wrong the offset is at most.
    pub fn error_ms(&self) -> f64 {
        (self.value - self.bounds.start).abs().max((self.bounds.end - self.value).abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device whose clock runs at another rate than the host's.
    struct Fake {
        rate: f64,
        /// Where it is at the host's 0.
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

        /// From 0 to `most_ms`.
        fn delay_ms(&mut self, most_ms: f64) -> f64 {
            self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.random) / f64::from(u32::MAX) * most_ms
        }

        /// Work of 8 ms that is handed out at this time and begins and is seen to have ended with so much delay at most.
        /// Returns how far off the offset is at its end.
        fn frame(&mut self, offset: &mut Offset, host_ms: f64, delay_ms: f64) -> f64 {
            let begin_ms = host_ms + 0.01 + self.delay_ms(delay_ms);
            let end_ms = begin_ms + 8.0;
            let seen_ms = end_ms + 0.02 + self.delay_ms(delay_ms);
            let device_ms = self.device_ms(begin_ms)..self.device_ms(end_ms);
            offset.narrow(&device_ms, &(host_ms..seen_ms));
            (device_ms.end + offset.value() - end_ms).abs()
        }
    }

    /// Ten minutes of frames: 50 ppm are 30 ms.
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

    /// What was known well stays so as long as nothing speaks against it.
    #[test]
    fn loose_brackets_do_not_move_a_clock_that_keeps_its_rate() {
        let (mut fake, mut offset) = (Fake::new(0.0), Offset::default());
        fake.frame(&mut offset, 0.0, 0.0);
        let before = offset.value();
        for frame in 1..1000 {
            fake.frame(&mut offset, f64::from(frame) * 100.0, 20.0);
        }
        assert_eq!(offset.value(), before);
    }

    /// As where a device's clock begins anew after it slept, or the host's stood still.
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
    fn brackets_that_contradict_themselves_say_nothing_but_at_the_start() {
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
