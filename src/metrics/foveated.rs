//! Foveated error: mean FLIP weighted by visual acuity around the gaze, with two models of acuity.
//!
//! Acuity at eccentricity e falls as e2 / (e + e2) (Geisler & Perry 1998, "A real-time foveated multiresolution system
//! for low-bandwidth video communication": contrast threshold CT0·exp(α·f·(e + e2)/e2), e2 = 2.3 degrees). In this
//! model, a pixel's weight is the square of its acuity, since acuity measures detail along a line, and a pixel covers
//! an area. The other model is [`acuity`].

use super::Pair;
use super::rings::Viewing;
use crate::projection::acuity::acuity;

/// Eccentricity at which acuity has fallen to one half.
const HALF_ACUITY_DEG: f64 = 2.3;

impl Pair {
    /// Returns mean FLIP weighted by Geisler and Perry's acuity, 0 … 1.
    pub fn foveated_flip(&self, viewing: &Viewing) -> f64 {
        self.weighted_flip(viewing, |degrees| (HALF_ACUITY_DEG / (HALF_ACUITY_DEG + degrees)).powi(2))
    }

    /// Returns mean FLIP weighted by the acuity model of visual-polar images, 0 … 1.
    pub fn acuity_flip(&self, viewing: &Viewing) -> f64 {
        self.weighted_flip(viewing, acuity)
    }

    /// Returns the mean FLIP of the pixels within `degrees` of the gaze, or `None` if there are no such pixels.
    pub fn flip_near_gaze(&self, viewing: &Viewing, degrees: f64) -> Option<f64> {
        let flip = self.weighted_flip(viewing, |angle| if angle <= degrees { 1.0 } else { 0.0 });
        flip.is_finite().then_some(flip)
    }

    fn weighted_flip(&self, viewing: &Viewing, weight: impl Fn(f64) -> f64) -> f64 {
        let sums = self.eccentricities(viewing).zip(self.flip()).fold([0.0; 2], |[error, all], (angle, flip)| {
            let w = weight(angle.to_degrees());
            [error + w * flip, all + w]
        });
        sums[0] / sums[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Extent, RgbImage};

    #[test]
    fn foveated_errors_weigh_most_at_the_gaze() {
        let grey = RgbImage::filled(Extent::new(64, 48), [0.5; 3]);
        let viewing = |x: f64| Viewing { gaze: [x, 0.5], yfov_deg: 70.0 };
        let mut left_wrong = grey.clone();
        for (i, pixel) in left_wrong.pixels.iter_mut().enumerate().filter(|(i, _)| i % 64 < 32) {
            *pixel = [2.0, 0.1 * (i % 3) as f32, 0.0];
        }
        let pair = Pair::new(&grey, &left_wrong, 0.0).unwrap();
        let mean = pair.errors().flip;
        for measure in [Pair::foveated_flip, Pair::acuity_flip] {
            let [at_left, at_right] = [0.25, 0.75].map(|x| measure(&pair, &viewing(x)));
            assert!(at_left > 1.3 * mean && at_right < 0.7 * mean, "{at_left} {mean} {at_right}");
        }
        let [at_left, at_right] = [0.25, 0.75].map(|x| pair.flip_near_gaze(&viewing(x), 10.0).unwrap());
        assert!(at_left > 1.8 * mean && at_right < 0.05 * mean, "{at_left} {mean} {at_right}");
        assert_eq!(pair.flip_near_gaze(&viewing(0.5), 0.1), None);
        assert!((pair.flip_near_gaze(&viewing(0.5), 180.0).unwrap() / mean - 1.0).abs() < 1e-9);
        let all_wrong = RgbImage::filled(grey.extent, [2.0, 0.1, 0.0]);
        let pair = Pair::new(&grey, &all_wrong, 0.0).unwrap();
        // FLIP's filters extend beyond the image's borders, where both images agree.
        for measure in [Pair::foveated_flip, Pair::acuity_flip] {
            let ratio = measure(&pair, &viewing(0.5)) / pair.errors().flip;
            assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
        }
    }
}
