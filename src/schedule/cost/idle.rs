//! The fixed cost of path tracing: the time that a pixel takes besides its rays, in rays.
//!
//! A pass that traces paths takes s · (rays + k · pixels). Frames of one quality cannot tell s from k. After a change of
//! quality, the measured time differs from the prediction by a factor that depends on k. An extended Kalman filter with
//! the scalar state k (Simon 2006, "Optimal State Estimation", section 13.2) learns from this factor.

/// k before anything was learned, and its variance.
const PRIOR: f64 = 1.0 / 32.0;
const PRIOR_VARIANCE: f64 = 1.0;
/// Variance that k gains with each frame, since scenes and views change.
const DRIFT: f64 = 1e-4;
/// Variance of the logarithm of measured over predicted time, from the scatter of frames.
const NOISE: f64 = 0.15 * 0.15;
/// Minimum of k, above 0: views without holes take time, too, and no time per unit of work is infinite.
const LEAST: f64 = 1e-3;
/// Maximum of k.
const MOST: f64 = 8.0;
/// Maximum logarithm of measured over predicted time. Larger deviations have other causes.
const LARGEST_DEVIATION: f64 = 0.5;
/// Weight of a new frame in the mean number of rays. It matches that of times per unit of work.
const RATE: f64 = 0.2;

/// Learned fixed cost of one pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct IdleRays {
    rays: f64,
    variance: f64,
    /// Mean number of rays per pixel of the frames from which times per ray were learned.
    usual: Option<f64>,
}

impl Default for IdleRays {
    fn default() -> Self {
        Self { rays: PRIOR, variance: PRIOR_VARIANCE, usual: None }
    }
}

impl IdleRays {
    /// Returns the fixed cost per pixel, in rays.
    pub fn per_pixel(&self) -> f64 {
        self.rays
    }

    /// Learns from a frame with this many rays per pixel that took `ratio` times its predicted time. Returns the factor
    /// by which times per unit must be multiplied so that predictions for frames like the past ones stay as they are.
    pub fn learn(&mut self, rays: f64, ratio: Option<f64>) -> f64 {
        if !(rays.is_finite() && rays >= 0.0) {
            return 1.0;
        }
        let before = self.rays;
        let usual = *self.usual.get_or_insert(rays);
        self.usual = Some(usual + RATE * (rays - usual));
        let (now, usual) = (rays + before, usual + before);
        let deviation = ratio.map_or(f64::NAN, f64::ln);
        if !deviation.is_finite() || now <= 0.0 || usual <= 0.0 {
            return 1.0;
        }
        let slope = 1.0 / now - 1.0 / usual;
        self.variance += DRIFT;
        let gain = self.variance * slope / (slope * slope * self.variance + NOISE);
        self.variance *= 1.0 - gain * slope;
        let step = gain * deviation.clamp(-LARGEST_DEVIATION, LARGEST_DEVIATION);
        self.rays = (before + step).clamp(LEAST, MOST);
        usual / (usual - before + self.rays)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pass that takes 2 µs per ray and the time of half a ray per pixel, at two qualities in turns.
    #[test]
    fn fixed_cost_is_learned_from_quality_changes() {
        let (mut idle, mut ms_per_unit) = (IdleRays::default(), None::<f64>);
        let mut learned_at_one = f64::NAN;
        for frame in 0..240 {
            let rays = if frame / 40 % 2 == 0 { 3.0 } else { 9.0 };
            let ms = 2.0 * (rays + 0.5);
            let predicted = ms_per_unit.map(|s| s * (rays + idle.per_pixel()));
            let factor = idle.learn(rays, predicted.map(|predicted| ms / predicted));
            let own = ms / (rays + idle.per_pixel());
            ms_per_unit = Some(ms_per_unit.map_or(own, |s| s * factor + (own - s * factor) * RATE));
            if frame == 39 {
                learned_at_one = idle.per_pixel();
            }
        }
        assert!((learned_at_one - PRIOR).abs() < 1e-9, "one quality tells nothing: {learned_at_one}");
        assert!((idle.per_pixel() - 0.5).abs() < 0.1, "{}", idle.per_pixel());
        assert!((ms_per_unit.unwrap() * (3.0 + idle.per_pixel()) / 7.0 - 1.0).abs() < 0.02);
    }

    #[test]
    fn first_hole_after_frames_without_keeps_times_finite() {
        let mut idle = IdleRays::default();
        assert_eq!(idle.learn(0.0, None), 1.0);
        let factor = idle.learn(0.02, Some(2.0));
        assert!(factor.is_finite() && idle.per_pixel() == LEAST, "{factor}, {}", idle.per_pixel());
    }

    #[test]
    fn invalid_measurements_keep_the_cost_in_its_range() {
        let mut idle = IdleRays::default();
        for (rays, ratio) in [(f64::NAN, 1.0), (0.0, 0.0), (1e9, 1e9), (0.0, 1e-9), (4.0, f64::INFINITY), (4.0, -1.0)] {
            let factor = idle.learn(rays, Some(ratio));
            assert!(factor.is_finite() && factor > 0.0, "{factor}");
            assert!((LEAST..=MOST).contains(&idle.per_pixel()));
        }
    }
}
