//! State of a frame that takes long: its progress, and its end before it has all samples.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::stopping::StopFlag;

/// Bound of the predicted time of a submission on devices without a bound of their own, in milliseconds. The device can
/// end a frame between two submissions.
pub const WATCHED_DISPATCH_MS: f64 = 200.0;

/// Communication of the renderer and its workers about one frame while it is being rendered.
#[derive(Debug, Default)]
pub struct Watch {
    /// Flag that ends the frame with the samples so far; none if the frame must be complete.
    ends: StopFlag,
    /// Fraction of the work that each device has done, as the bits of an `f64`.
    done: Vec<AtomicU64>,
    /// True if it would take long to complete a picture of the samples so far.
    is_hopeless: AtomicBool,
}

impl Watch {
    pub fn new(ends: StopFlag, devices: usize) -> Self {
        Self { ends, done: (0..devices).map(|_| AtomicU64::default()).collect(), is_hopeless: AtomicBool::default() }
    }

    /// True if the frame must end with the samples so far.
    pub fn is_ending(&self) -> bool {
        self.ends.is_set()
    }

    /// Records the fraction of the work that a device has done.
    pub fn progress(&self, device: usize, fraction: f64) {
        if let Some(done) = self.done.get(device) {
            done.store(fraction.min(1.0).to_bits(), Ordering::Relaxed);
        }
    }

    /// Records that it would take long to complete a picture of the samples so far.
    pub fn give_up(&self) {
        self.is_hopeless.store(true, Ordering::Relaxed);
    }

    /// True if it would take long to complete a picture of the samples so far.
    pub fn is_hopeless(&self) -> bool {
        self.is_hopeless.load(Ordering::Relaxed)
    }

    /// True if the frame can end with the samples so far.
    pub fn ends_with_picture(&self) -> bool {
        self.ends.exists()
    }

    /// Returns the fraction of the work that these devices have done.
    pub fn fraction(&self, devices: &[usize]) -> f64 {
        let done = devices.iter().filter_map(|&device| self.done.get(device));
        let sum: f64 = done.map(|done| f64::from_bits(done.load(Ordering::Relaxed))).sum();
        sum / devices.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_the_mean_over_devices() {
        let watch = Watch::new(StopFlag::default(), 3);
        watch.progress(0, 0.5);
        watch.progress(2, 1.0);
        watch.progress(7, 1.0);
        assert_eq!((watch.fraction(&[0, 1]), watch.fraction(&[0, 2]), watch.fraction(&[])), (0.25, 0.75, 0.0));
        assert!(!watch.is_ending() && !watch.ends_with_picture());
    }
}
