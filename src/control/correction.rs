//! Correction of predicted frame times, learned from measured ones: a factor, and the scatter of frames around it.

use std::collections::VecDeque;

/// Number of frames in the median, so that a single delayed frame has no effect.
const WINDOW: usize = 3;
/// Weight of a new median in the running mean.
const LEARNING_RATE: f64 = 0.15;
/// Ratio of median to mean, or of mean to median, above which the load has changed and the median replaces the mean.
/// The threshold grows with the scatter of frames, from the first value up to the second.
const LEAP: [f64; 2] = [1.3, 1.75];
/// Ratios above this, or below its inverse, are clamped to it. Clocks and predictors that are off by more are broken.
const RATIO_MAX: f64 = 1e3;
/// Weight of a frame's deviation in the running mean of deviations.
const SPREAD_RATE: f64 = 0.05;
/// Standard deviation over mean deviation of a normal distribution: √(π/2).
const SIGMA_PER_DEVIATION: f64 = 1.253_314_137_315_500_3;

/// The state of the correction, in logarithms of measured over predicted time.
#[derive(Clone, Debug, Default)]
pub struct Correction {
    /// Rung and measured time of the last frames. Each decision computes their ratios with the current predictions, so
    /// a predictor that learns by itself is not corrected twice.
    frames: VecDeque<(usize, f64)>,
    mean: f64,
    has_mean: bool,
    deviation: f64,
    /// True if a frame was added since the mean was last updated.
    has_new_frame: bool,
}

impl Correction {
    /// Adds a frame on this rung that took `ms`, which must be positive.
    pub fn learn(&mut self, rung: usize, ms: f64) {
        if self.frames.len() == WINDOW {
            self.frames.pop_front();
        }
        self.frames.push_back((rung, ms));
        self.has_new_frame = true;
    }

    /// Updates the factor from the ratios of recent measured times to current predictions. `predicted_ms` predicts the
    /// time of a rung.
    pub fn update(&mut self, predicted_ms: impl Fn(usize) -> f64) {
        if !std::mem::take(&mut self.has_new_frame) || self.frames.len() < 2 {
            return;
        }
        let ratio = |&(rung, ms): &(usize, f64)| (ms / predicted_ms(rung)).clamp(1.0 / RATIO_MAX, RATIO_MAX).ln();
        let mut ratios: Vec<f64> = self.frames.iter().map(ratio).collect();
        let newest = ratios[ratios.len() - 1];
        ratios.sort_by(f64::total_cmp);
        // With two frames, the smaller ratio counts, since the very first frame is cold.
        let median = ratios[(ratios.len() - 1) / 2];
        let error = median - self.mean;
        let leap = (LEAP[0].ln() + 2.0 * SIGMA_PER_DEVIATION * self.deviation).min(LEAP[1].ln());
        let is_new = !std::mem::replace(&mut self.has_mean, true) || error.abs() > leap;
        self.mean = if is_new { median } else { self.mean + LEARNING_RATE * error };
        let deviation = (newest - self.mean).abs();
        if deviation < 2.0 * leap {
            self.deviation += SPREAD_RATE * (deviation - self.deviation);
        }
    }

    /// Returns the factor that corrects predictions.
    pub fn factor(&self) -> f64 {
        self.mean.exp()
    }

    /// Returns 1 + the relative standard deviation of frames.
    pub fn margin(&self) -> f64 {
        (SIGMA_PER_DEVIATION * self.deviation).exp()
    }

    /// Discards the last frames, which do not predict the next ones.
    pub fn forget_frames(&mut self) {
        self.frames.clear();
    }
}
