//! Progressive accumulation of many samples per pixel in passes: the sum on the host, checkpoints to resume from, and
//! an estimate of the remaining noise.
//!
//! A device's running mean is f32, so a pass stays short. The host adds passes in f64, so that the mean over any number
//! of passes is exact to f32 rounding.

mod checkpoint;
mod fingerprint;
mod fnv;
mod passes;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use fingerprint::{Fingerprint, Subject};
pub use fnv::hash_of;
pub use passes::{AccumulateError, Done, Job, Pass, accumulate};

use std::fmt;

use serde::Serialize;

use crate::exec::PerView;
use crate::image::{Extent, Image, RgbImage};
use crate::metrics::error;

/// Sum over all samples of the even passes, or of the odd passes.
#[derive(Clone, Debug, PartialEq)]
struct Half {
    samples: u32,
    /// Row-major radiance, left and right eye.
    sums: Vec<Vec<[f64; 3]>>,
}

/// Radiance summed over samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Accumulation {
    extent: Extent,
    /// Sums of even and of odd passes: two estimates of the same mean that differ only by noise.
    halves: [Half; 2],
    /// Number of non-finite samples, which count as black, over all views.
    dropped: u64,
}

/// Estimated error of the mean, by the definitions of [`crate::metrics`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Noise {
    pub rmse: f64,
    pub relmse: f64,
}

impl fmt::Display for PerView<Noise> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [l, r] = self.outer();
        write!(f, "RMSE {:.3e} left, {:.3e} right; relMSE {:.3e} and {:.3e}", l.rmse, r.rmse, l.relmse, r.relmse)
    }
}

impl Accumulation {
    pub fn new(extent: Extent, views: usize) -> Self {
        let half = || Half { samples: 0, sums: vec![vec![[0.0; 3]; extent.area()]; views] };
        Self { extent, halves: [half(), half()], dropped: 0 }
    }

    pub fn samples(&self) -> u32 {
        self.halves.iter().map(|h| h.samples).sum()
    }

    /// Returns the number of non-finite samples over all views.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Adds a pass: the mean over `samples` samples, of which devices dropped `dropped`. `number` counts passes from 0.
    /// All samples of a non-finite pixel are dropped.
    ///
    /// # Panics
    /// If the images have another extent.
    pub fn add(&mut self, number: u32, mean: &PerView<RgbImage>, samples: u32, dropped: u64) {
        let half = &mut self.halves[(number % 2) as usize];
        half.samples += samples;
        self.dropped += dropped;
        for (sums, image) in half.sums.iter_mut().zip(mean.iter()) {
            assert_eq!(image.extent, self.extent);
            for (sum, pixel) in sums.iter_mut().zip(&image.pixels) {
                if pixel.iter().all(|c| c.is_finite()) {
                    *sum = std::array::from_fn(|c| sum[c] + f64::from(pixel[c]) * f64::from(samples));
                } else {
                    self.dropped += u64::from(samples);
                }
            }
        }
    }

    /// Returns the mean over all samples; black if there are none.
    pub fn mean(&self) -> PerView<RgbImage> {
        let count = f64::from(self.samples().max(1));
        let eye = |e: usize| {
            let [a, b] = &self.halves;
            let pixels = a.sums[e].iter().zip(&b.sums[e]);
            let mean = |(a, b): (&[f64; 3], &[f64; 3])| std::array::from_fn(|c| ((a[c] + b[c]) / count) as f32);
            Image { extent: self.extent, pixels: pixels.map(mean).collect() }
        };
        (0..self.halves[0].sums.len()).map(eye).collect()
    }

    /// Returns the standard error of the mean, estimated from the difference of the halves' means A and B. For n_A and
    /// n_B independent samples of variance s, E(A − B)² = s (1/n_A + 1/n_B). The mean over all has the variance s /
    /// (n_A + n_B), which is E(A − B)² · n_A n_B / (n_A + n_B)². The errors of a Sobol' sequence's halves partly
    /// cancel, so the estimate is conservative there. Returns `None` before there are two passes.
    pub fn noise(&self) -> Option<PerView<Noise>> {
        let [a, b] = &self.halves;
        let [n_a, n_b] = [a, b].map(|h| f64::from(h.samples));
        let share = n_a * n_b / (n_a + n_b).powi(2);
        // Differences are relative to the mean over all samples, which is less noisy than that of a half.
        let eye = |e: usize| {
            let pixels = a.sums[e].iter().zip(&b.sums[e]);
            let (mean, off): (Vec<[f64; 3]>, Vec<[f64; 3]>) = pixels
                .map(|(a, b)| {
                    let mean: [f64; 3] = std::array::from_fn(|c| (a[c] + b[c]) / (n_a + n_b));
                    (mean, std::array::from_fn(|c| mean[c] + a[c] / n_a - b[c] / n_b))
                })
                .unzip();
            Noise { rmse: error::rmse(&mean, &off) * share.sqrt(), relmse: error::relmse(&mean, &off) * share }
        };
        (share > 0.0).then(|| (0..a.sums.len()).map(eye).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(extent: Extent, value: f32) -> PerView<RgbImage> {
        let image = RgbImage::filled(extent, [value; 3]);
        PerView::both(image.clone(), image)
    }

    /// A running mean in f32 stalls once 1/n is below half a unit in the last place of the mean.
    #[test]
    fn mean_of_many_passes_does_not_drift() {
        let extent = Extent::new(2, 1);
        let mut sum = Accumulation::new(extent, 2);
        let passes = 1 << 20;
        for i in 0..passes {
            let value = if i < passes / 2 { 1.0 } else { 1.1f32 };
            sum.add(i, &flat(extent, value), 8, 0);
        }
        let expected = (1.0 + f64::from(1.1f32)) / 2.0;
        let found = sum.mean().left().pixels[0][0];
        assert_eq!((found, sum.samples()), (expected as f32, 8 << 20));
    }

    #[test]
    fn passes_count_by_their_samples() {
        let extent = Extent::new(1, 1);
        let mut sum = Accumulation::new(extent, 2);
        assert_eq!((sum.mean().left().pixels[0], sum.noise().is_none()), ([0.0; 3], true));
        sum.add(0, &flat(extent, 1.0), 8, 0);
        assert!(sum.noise().is_none());
        sum.add(1, &flat(extent, 5.0), 2, 3);
        assert_eq!((sum.mean().right().pixels[0], sum.dropped()), ([1.8; 3], 3));
    }

    #[test]
    fn non_finite_pixels_count_as_dropped_samples() {
        let extent = Extent::new(2, 1);
        let mut sum = Accumulation::new(extent, 2);
        let pass = flat(extent, 1.0).map(|image| Image { pixels: vec![[1.0; 3], [1.0, f32::NAN, 1.0]], ..image });
        sum.add(0, &pass, 8, 1);
        assert_eq!((sum.mean().left().pixels[1], sum.dropped()), ([0.0; 3], 17));
    }

    /// Pixels of independent noise of variance 1: the mean of n samples has the standard error 1/√n. With 2·10⁴ pixels
    /// of three channels the estimate's own relative error is 1/√(2 · 6·10⁴) = 0.3 %.
    #[test]
    fn noise_is_the_standard_error_of_the_mean() {
        let extent = Extent::new(200, 100);
        let mut state = 1u32;
        // A uniform distribution of width √12 has variance 1.
        let mut sample = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            ((f64::from(state >> 8) / f64::from(1 << 24) - 0.5) * 12f64.sqrt()) as f32
        };
        let mut sum = Accumulation::new(extent, 2);
        for number in 0..9 {
            let mut image =
                || Image { extent, pixels: (0..extent.area()).map(|_| [(); 3].map(|()| sample())).collect() };
            let pass = PerView::both(image(), image());
            sum.add(number, &pass, 1, 0);
        }
        let noise = sum.noise().unwrap();
        for found in noise.outer().map(|noise| noise.rmse) {
            assert!((found * 3.0 - 1.0).abs() < 0.015, "{found}");
        }
    }
}
