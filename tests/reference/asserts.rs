//! Compares results of the reference with closed forms.

use super::ztest::Estimate;

/// Asserts that the value equals `expected` to f32 input, without noise.
#[track_caller]
pub fn assert_exact(found: &Estimate, expected: [f64; 3]) {
    for (c, &e) in expected.iter().enumerate() {
        let (mean, sigma) = (found.mean[0][c], found.variance_of_mean[0][c].sqrt());
        let allowed = 1e-5 * e.abs() + 1e-9;
        assert!((mean - e).abs() <= allowed, "channel {c}: {mean} is not {e}");
        assert!(sigma <= allowed, "channel {c}: {mean} ± {sigma} has noise");
    }
}

/// Asserts that the value equals `expected` within its noise, and that the noise is below `resolution` of it.
#[track_caller]
pub fn assert_near(found: &Estimate, expected: f64, resolution: f64) {
    for c in 0..3 {
        let (mean, sigma) = (found.mean[0][c], found.variance_of_mean[0][c].sqrt());
        let z = (mean - expected) / (sigma + 1e-5 * expected.abs());
        assert!(z.abs() < 4.5, "channel {c}: {mean} ± {sigma} is not {expected} (z = {z:.2})");
        assert!(sigma <= resolution * expected.abs(), "channel {c}: {mean} ± {sigma} is too noisy");
    }
}
