//! Estimators for noisy measurements whose first samples are distorted by cold caches: a running mean, and a straight
//! line fitted by least squares.

/// Weight of a new measurement in a running mean of many, so that the scatter of single frames hardly moves stripes and
/// quality.
const LEARNING_RATE: f64 = 0.2;
/// The same where other work is measured than before, such as other rows.
const CHANGED_RATE: f64 = 0.5;
/// Factor above and below the running mean beyond which the median of the last measurements replaces the mean, so that a
/// lasting change of a device's load shows within [`WINDOW`] frames. Single measurements are clamped to these factors.
const LEAP: f64 = 1.4;
/// Number of measurements in that median.
const WINDOW: usize = 3;
/// Factor by which the weight of past transfers decreases with each frame.
const MEMORY: f64 = 0.9;

/// Running mean, at first of all measurements, later with exponentially falling weights. The second measurement replaces
/// the first, since the first frame runs with cold caches.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    value: f64,
    measurements: u32,
    /// The last measurements, the newest last.
    last: [f64; WINDOW],
}

impl Mean {
    /// Adds a measurement. Values that are not positive are ignored.
    pub fn learn(&mut self, measured: f64) {
        if measured > 0.0 {
            self.learn_at(LEARNING_RATE, measured);
        }
    }

    /// Adds a measurement of other work than before. Values that are not positive are ignored.
    pub fn learn_changed(&mut self, measured: f64) {
        if measured > 0.0 {
            self.learn_at(CHANGED_RATE, measured);
        }
    }

    /// Adds a measurement that may be 0. If the mean is 0, the measurement replaces it.
    pub fn learn_with_zero(&mut self, measured: f64) {
        self.learn_at(LEARNING_RATE, measured);
    }

    fn learn_at(&mut self, rate: f64, measured: f64) {
        if !measured.is_finite() || measured < 0.0 {
            return;
        }
        self.last.rotate_left(1);
        self.last[WINDOW - 1] = measured;
        self.value = if self.measurements < 2 || self.value == 0.0 {
            measured
        } else {
            let mut last = self.last;
            last.sort_by(f64::total_cmp);
            let (median, usual) = (last[WINDOW / 2], self.value / LEAP..=self.value * LEAP);
            // Before there are enough measurements, the array still holds zeros.
            if self.measurements as usize >= WINDOW && !usual.contains(&median) {
                median
            } else {
                let bounded = measured.clamp(*usual.start(), *usual.end());
                self.value + (bounded - self.value) * rate.max(1.0 / f64::from(self.measurements))
            }
        };
        self.measurements = self.measurements.saturating_add(1);
    }

    pub fn value(&self) -> Option<f64> {
        (self.measurements > 0).then_some(self.value)
    }

    /// Returns the mean; `None` until a second measurement has replaced the cold first one.
    pub fn warm_value(&self) -> Option<f64> {
        self.value().filter(|_| self.measurements > 1)
    }

    /// Creates the mean of a quantity that is known in advance.
    pub fn known(value: f64) -> Self {
        Self { value, measurements: 2, last: [value; WINDOW] }
    }

    /// Multiplies everything that was learned by `factor`, after a change of the unit.
    pub fn scale(&mut self, factor: f64) {
        self.value *= factor;
        self.last.iter_mut().for_each(|last| *last *= factor);
    }
}

/// Time of a transfer by its bytes: latency + bytes / bandwidth, fitted by least squares over past frames whose weight
/// fades.
#[derive(Clone, Copy, Debug, Default)]
pub struct Line {
    count: f64,
    bytes: f64,
    ms: f64,
    bytes_bytes: f64,
    bytes_ms: f64,
}

impl Line {
    pub fn learn(&mut self, bytes: f64, ms: f64) {
        self.add(&Self { count: 1.0, bytes, ms, bytes_bytes: bytes * bytes, bytes_ms: bytes * ms });
    }

    /// Adds everything that another line has learned.
    pub fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.bytes += other.bytes;
        self.ms += other.ms;
        self.bytes_bytes += other.bytes_bytes;
        self.bytes_ms += other.bytes_ms;
    }

    /// Reduces the weight of past measurements.
    pub fn fade(&mut self) {
        for sum in [&mut self.count, &mut self.bytes, &mut self.ms, &mut self.bytes_bytes, &mut self.bytes_ms] {
            *sum *= MEMORY;
        }
    }

    /// Returns latency in milliseconds and milliseconds per byte, neither below 0. Both are 0 before the first
    /// measurement.
    ///
    /// If the sizes are too similar to fit a slope, or the fitted latency is negative, fits a line through the origin
    /// instead. If the fitted slope is negative, returns the mean time as latency, and 0 per byte.
    pub fn fit(&self) -> (f64, f64) {
        if self.count <= 0.0 {
            return (0.0, 0.0);
        }
        let (mean_bytes, mean_ms) = (self.bytes / self.count, self.ms / self.count);
        if self.bytes_bytes <= 0.0 {
            return (mean_ms, 0.0);
        }
        let through_origin = (0.0, self.bytes_ms / self.bytes_bytes);
        let variance = self.bytes_bytes / self.count - mean_bytes * mean_bytes;
        if variance <= 1e-6 * mean_bytes * mean_bytes {
            return through_origin;
        }
        let slope = (self.bytes_ms / self.count - mean_bytes * mean_ms) / variance;
        let latency = mean_ms - slope * mean_bytes;
        match (slope < 0.0, latency < 0.0) {
            (true, _) => (mean_ms, 0.0),
            (_, true) => through_origin,
            _ => (latency, slope),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_limits_a_cold_first_frame_and_one_hiccup() {
        let mut mean = Mean::default();
        [50.0, 2.0, 2.0, 100.0].iter().for_each(|&ms| mean.learn(ms));
        // The fourth measurement has a third of the weight.
        let bound = 2.0 * (1.0 + (LEAP - 1.0) / 3.0) * (1.0 + 1e-9);
        assert!(mean.value().unwrap() <= bound);
        mean.learn(f64::NAN);
        mean.learn(0.0);
        assert!(mean.value().unwrap() <= bound);
    }

    #[test]
    fn mean_follows_a_change_after_two_measurements() {
        let mut mean = Mean::default();
        (0..20).for_each(|_| mean.learn(2.0));
        mean.learn(6.0);
        assert!(mean.value().unwrap() < 2.3);
        mean.learn(6.0);
        assert_eq!(mean.value(), Some(6.0));
    }

    #[test]
    fn mean_learns_zero_only_where_allowed() {
        let mut mean = Mean::default();
        mean.learn(0.0);
        assert_eq!(mean.value(), None);
        mean.learn_with_zero(4.0);
        assert_eq!((mean.value(), mean.warm_value()), (Some(4.0), None));
        mean.learn_with_zero(0.0);
        assert_eq!(mean.warm_value(), Some(0.0));
        mean.learn_with_zero(1.0);
        assert_eq!(mean.warm_value(), Some(1.0));
        mean.learn_with_zero(0.0);
        assert!(mean.warm_value() < Some(1.0));
    }

    #[test]
    fn line_fit_recovers_latency_and_slope() {
        let mut line = Line::default();
        for bytes in [1e3, 5e4, 2e5, 1e6] {
            line.learn(bytes, 0.05 + bytes * 1e-6);
            line.fade();
        }
        let (latency, slope) = line.fit();
        assert!((latency - 0.05).abs() < 1e-9 && (slope - 1e-6).abs() < 1e-12, "{latency} {slope}");
    }

    #[test]
    fn lines_of_degenerate_measurements_are_usable() {
        let fit = |points: &[(f64, f64)]| {
            let mut line = Line::default();
            points.iter().for_each(|&(bytes, ms)| line.learn(bytes, ms));
            line.fit()
        };
        assert_eq!(fit(&[]), (0.0, 0.0));
        assert_eq!(fit(&[(0.0, 2.0)]), (2.0, 0.0));
        assert_eq!(fit(&[(100.0, 2.0), (100.0, 4.0)]), (0.0, 0.03));
        assert_eq!(fit(&[(100.0, 4.0), (300.0, 2.0)]), (3.0, 0.0));
        let (latency, slope) = fit(&[(100.0, 0.1), (200.0, 1.0)]);
        assert!(latency == 0.0 && slope > 0.0);
    }
}
