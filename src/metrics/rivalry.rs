//! Binocular rivalry: errors that the two eyes do not share.
//!
//! Errors are differences of display values between an image and its reference, E(x) = image(x) − reference(x). The
//! difference between the eyes is D(x) = E_left(x) − E_right(x'), where x' is the right eye's pixel that shows the
//! surface at x ([`Surfaces::in_other_eye`](super::surfaces::Surfaces::in_other_eye)). Pixels without x' are not
//! averaged.
//!
//! **Rivalry** is the root mean square of D over matched pixels and channels. It is 0 if both eyes have the same errors,
//! for example because one was reprojected from the other, and √2·σ for noise of standard deviation σ that is
//! independent between the eyes. The references' own noise is part of it: the rivalry of a second reference against the
//! first, divided by √2, is the least that can be measured.
//!
//! **Seen rivalry** is the same of images and references after FLIP's contrast sensitivity filters
//! ([`flip::perceived`]): what remains of D on a display with FLIP's number of pixels per degree.

use serde::Serialize;

use super::flip;
use super::heatmap::{error_colour, rms};
use super::surfaces::Sighting;
use super::{Pair, Side};
use crate::image::display::DisplayImage;
use crate::image::{Extent, Image, ImageError, check_same_size};

/// Differences between the errors of the two eyes, per pixel of the left one.
pub struct Differences {
    extent: Extent,
    /// D of matched pixels.
    values: Vec<Option<[f64; 3]>>,
    /// D after contrast sensitivity filters.
    seen: Vec<Option<[f64; 3]>>,
    hidden_px: usize,
}

/// Rivalry between the eyes in display values 0 … 1; `None` if no surface is visible to both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Rivalry {
    /// Root mean square over matched pixels and channels.
    pub rivalry: Option<f64>,
    /// The same after contrast sensitivity filters.
    pub rivalry_seen: Option<f64>,
    /// Mean and 99th percentile over matched pixels of the root mean square over channels.
    pub rivalry_mean: Option<f64>,
    pub rivalry_p99: Option<f64>,
    /// Fraction of the left eye's surface pixels whose surface the right eye does not show.
    pub unmatched: Option<f64>,
}

/// Name and meaning of each field of [`Rivalry`], in order.
pub const RIVALRY_MEASURES: [(&str, &str); 5] = [
    ("rivalry", "RMS difference between the errors of the two eyes, displayed values; 0 is best"),
    ("rivalry_seen", "the same after FLIP's contrast filters"),
    ("rivalry_mean", "mean over pixels of the RMS over channels"),
    ("rivalry_p99", "99th percentile over pixels of the RMS over channels"),
    ("unmatched", "fraction of the left eye's surfaces that the right eye does not show"),
];

impl Rivalry {
    /// Returns the values in the order of [`RIVALRY_MEASURES`].
    pub fn values(&self) -> [Option<f64>; 5] {
        [self.rivalry, self.rivalry_seen, self.rivalry_mean, self.rivalry_p99, self.unmatched]
    }

    /// Returns the mean of each value over frames; `None` if it is undefined in one of them.
    pub fn mean_of(frames: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> Option<f64>| {
            let values: Option<Vec<f64>> = frames.iter().map(of).collect();
            values.filter(|v| !v.is_empty()).map(|v| v.iter().sum::<f64>() / v.len() as f64)
        };
        Self {
            rivalry: mean(|r| r.rivalry),
            rivalry_seen: mean(|r| r.rivalry_seen),
            rivalry_mean: mean(|r| r.rivalry_mean),
            rivalry_p99: mean(|r| r.rivalry_p99),
            unmatched: mean(|r| r.unmatched),
        }
    }
}

impl Differences {
    /// Subtracts the right eye's errors from the left eye's. `in_right` is where the right eye shows the surfaces of the
    /// left eye's pixels.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    ///
    /// # Panics
    /// If `in_right` does not have one entry per pixel.
    pub fn new(left: &Pair, right: &Pair, in_right: &[Sighting]) -> Result<Self, ImageError> {
        let extent = left.extent;
        check_same_size(extent, right.extent)?;
        assert_eq!(in_right.len(), extent.area(), "there must be one entry per pixel");
        let differences = |errors: [Vec<[f64; 3]>; 2]| -> Vec<Option<[f64; 3]>> {
            let [left, right] = &errors;
            let difference = |(left, sighting): (&[f64; 3], &Sighting)| match *sighting {
                Sighting::At(j) => Some([0, 1, 2].map(|c| left[c] - right[j][c])),
                Sighting::Sky | Sighting::Hidden => None,
            };
            left.iter().zip(in_right).map(difference).collect()
        };
        let shown = |pair: &Pair| (0..extent.area()).map(|i| pair.display_error(i)).collect();
        let seen = |pair: &Pair| {
            let [reference, image] =
                [&pair.reference, &pair.image].map(|side: &Side| flip::perceived(extent, &side.shown));
            reference.iter().zip(&image).map(|(r, a)| [0, 1, 2].map(|c| a[c] - r[c])).collect()
        };
        Ok(Self {
            extent,
            values: differences([left, right].map(shown)),
            seen: differences([left, right].map(seen)),
            hidden_px: in_right.iter().filter(|sighting| **sighting == Sighting::Hidden).count(),
        })
    }

    pub fn rivalry(&self) -> Rivalry {
        let mut sizes: Vec<f64> = self.values.iter().flatten().copied().map(rms).collect();
        sizes.sort_by(f64::total_cmp);
        let matched = sizes.len();
        let over = |sum: f64, count: usize| (count > 0).then(|| sum / count as f64);
        let squares = |values: &[Option<[f64; 3]>]| values.iter().flatten().map(|d| rms(*d).powi(2)).sum();
        Rivalry {
            rivalry: over(squares(&self.values), matched).map(f64::sqrt),
            rivalry_seen: over(squares(&self.seen), matched).map(f64::sqrt),
            rivalry_mean: over(sizes.iter().sum(), matched),
            rivalry_p99: sizes.get((0.99 * matched as f64) as usize).copied(),
            unmatched: over(self.hidden_px as f64, self.hidden_px + matched),
        }
    }

    /// Returns the mean absolute change of D since the previous frame, over channels and over the pixels that have a D in
    /// both. `history` is where the previous frame shows the left eye's surfaces.
    ///
    /// # Panics
    /// If `history` does not have one entry per pixel, or names a pixel outside the previous frame.
    pub fn flicker(&self, before: &Self, history: &[Sighting]) -> Option<f64> {
        assert_eq!(history.len(), self.values.len(), "there must be one entry per pixel");
        let pairs = self.values.iter().zip(history).filter_map(|(now, sighting)| match *sighting {
            Sighting::At(j) => now.zip(before.values[j]),
            Sighting::Sky | Sighting::Hidden => None,
        });
        let changes: Vec<f64> =
            pairs.map(|(now, before)| (0..3).map(|c| (now[c] - before[c]).abs()).sum::<f64>() / 3.0).collect();
        (!changes.is_empty()).then(|| changes.iter().sum::<f64>() / changes.len() as f64)
    }

    /// Returns a map of the root mean square of D over channels, on the scale of heatmaps. Pixels that the right eye does
    /// not match are grey.
    pub fn map(&self) -> DisplayImage {
        let pixels = self.values.iter().map(|d| d.map_or([96; 3], |d| error_colour(rms(d)))).collect();
        Image { extent: self.extent, pixels }
    }
}

#[cfg(test)]
pub(super) mod tests;
