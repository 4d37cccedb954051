//! Intervals of means over few runs or turns, and of ratios measured in turns.

use super::statistics::{deviation, mean};

/// 97.5 % quantiles of Student's t distribution with 1 to 9 degrees of freedom.
const STUDENT_T: [f64; 9] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262];

/// Returns the 97.5 % quantile of Student's t distribution. From 10 degrees of freedom on, it is expanded around that of
/// the normal distribution (Abramowitz & Stegun 1964, 26.7.5).
fn student_t(freedom: usize) -> f64 {
    const Z: f64 = 1.959_964;
    let n = freedom as f64;
    let expanded = || {
        let (a, b) = ((Z.powi(3) + Z) / 4.0, (5.0 * Z.powi(5) + 16.0 * Z.powi(3) + 3.0 * Z) / 96.0);
        Z + a / n + b / (n * n)
    };
    freedom.checked_sub(1).and_then(|i| STUDENT_T.get(i)).copied().unwrap_or_else(expanded)
}

/// Returns the ends of the 95 % interval of the mean (Student 1908), which also holds for few values. Returns `None`
/// for a single value, and for values that are all equal: their spread is unknown.
pub fn interval(values: &[f64]) -> Option<[f64; 2]> {
    let freedom = values.len().checked_sub(1).filter(|n| *n > 0)?;
    let mean = mean(values);
    let half = student_t(freedom) * deviation(values) / (values.len() as f64).sqrt();
    (half > 0.0 && half.is_finite()).then_some([mean - half, mean + half])
}

/// Returns the ends of the 95 % interval of the geometric mean of times, errors or ratios, which are positive. Returns
/// `None` if the interval is unknown, as that of [`interval`].
pub fn positive_interval(values: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let logs: Vec<f64> = values.into_iter().map(f64::ln).collect();
    Some(interval(&logs)?.map(f64::exp))
}

/// Returns the [`positive_interval`] of the ratio of two quantities that were measured in the same turns. Load that
/// changes between turns affects both and cancels.
pub fn ratio_interval(above: &[f64], below: &[f64]) -> Option<[f64; 2]> {
    positive_interval(above.iter().zip(below).map(|(a, b)| a / b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws means of few runs with normal scatter, and counts the intervals that contain the true mean.
    #[test]
    fn intervals_cover_the_true_mean_in_95_of_100_cases() {
        const CASES: usize = 20_000;
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        };
        let mut normal = || (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
        for runs in [2, 3, 4, 5, 8, 12, 40] {
            let covered = (0..CASES).filter(|_| {
                let values: Vec<f64> = (0..runs).map(|_| 7.0 + 3.0 * normal()).collect();
                let [low, high] = interval(&values).unwrap();
                (low..=high).contains(&7.0)
            });
            let share = covered.count() as f64 / CASES as f64;
            // The standard error is 0.0015.
            assert!((share - 0.95).abs() < 0.006, "{runs} runs: {share}");
        }
    }

    #[test]
    fn ratios_are_known_better_than_their_parts() {
        // Other programs take half of the machine in two of the turns.
        let load = [1.0, 2.0, 1.01, 1.98, 1.0];
        let times = |ms: f64, jitter: [f64; 5]| -> Vec<f64> { (0..5).map(|i| ms * load[i] * jitter[i]).collect() };
        let [slow, fast] = [times(21.0, [1.0, 1.01, 0.99, 1.0, 1.01]), times(20.0, [1.01, 1.0, 1.0, 0.99, 1.0])];
        let [low, high] = ratio_interval(&slow, &fast).unwrap();
        assert!(1.0 < low && low < 1.05 && 1.05 < high && high < 1.08, "{low} to {high}");
        let [of_slow, of_fast] = [slow.clone(), fast].map(|times| positive_interval(times).unwrap());
        assert!(0.0 < of_slow[0] && of_slow[0] < of_fast[1]);
        assert_eq!(ratio_interval(&[0.0, 1.0], &[1.0, 1.0]), None);
    }
}
