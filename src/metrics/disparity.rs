//! Disparity of features that are not on the surfaces: highlights, reflections and refractions.
//!
//! The two eyes see such a feature at a depth of its own. A renderer that takes over light from one eye at the depth of
//! the surface moves it there. A feature is a block of the left reference (9x5 pixels) that is found in the same rows of
//! the right reference, at a disparity that differs from that of the block's surface by more than half a pixel.
//! Blocks are compared by the sum of squared differences of display values, with the vertex of a parabola between whole
//! pixels. The disparity of the feature in the compared images is found in the same way, around that in the references.

use serde::Serialize;

use super::surfaces::Surfaces;
use super::{Pair, Side};
use crate::image::{ImageError, check_same_size};

/// Columns and rows of a block on either side of its centre.
const BLOCK: [usize; 2] = [4, 2];
/// Columns and rows between the centres of blocks.
const STEP: usize = 2;
/// Least standard deviation of a block's display values: less is no feature.
const LEAST_CONTRAST: f64 = 0.03;
/// Greatest difference between the matching blocks of a feature, as a fraction of its variance.
const MOST_UNLIKE: f64 = 0.1;
/// Least ratio of the difference of any other block to that of the best one. A feature with less is ambiguous.
const LEAST_UNIQUE: f64 = 2.0;
/// Least difference between the disparities of a feature and of its surface, px.
const LEAST_APART: f64 = 0.5;
/// Greatest difference of disparities that is searched for in the compared images, px.
const REACH: i32 = 3;
/// Greatest disparity that is searched for in the references, px.
const FARTHEST: i32 = 64;

/// Errors of the disparity of features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FeatureDisparity {
    /// Number of features. They overlap.
    pub features: usize,
    /// Median and 95th percentile of the absolute difference between the disparities in the images and in the
    /// references, px; at most 3. `None` without features.
    pub disparity_off: Option<f64>,
    pub disparity_off_p95: Option<f64>,
}

/// Name and meaning of each field of [`FeatureDisparity`], in order.
pub const FEATURE_MEASURES: [(&str, &str); 3] = [
    ("features", "number of blocks with highlights, reflections or refractions off the surface"),
    ("disparity_off", "median error of their disparity, px; 0 is best"),
    ("disparity_off_p95", "95th percentile of this error"),
];

impl FeatureDisparity {
    /// Returns the values in the order of [`FEATURE_MEASURES`].
    pub fn values(&self) -> [Option<f64>; 3] {
        [Some(self.features as f64), self.disparity_off, self.disparity_off_p95]
    }

    /// Returns the measures of features with these errors in pixels.
    pub fn of_errors(mut errors: Vec<f64>) -> Self {
        errors.sort_by(f64::total_cmp);
        let quantile = |fraction: f64| errors.get((fraction * errors.len() as f64) as usize).copied();
        Self { features: errors.len(), disparity_off: quantile(0.5), disparity_off_p95: quantile(0.95) }
    }

    /// Finds the features of two eyes, and returns their errors in pixels. `surfaces` are those of the left eye,
    /// `world_to_ndc` is the right eye's matrix of that name, for row vectors, and `pixel_centre` is the sample position in
    /// each pixel.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn errors(
        left: &Pair,
        right: &Pair,
        surfaces: &Surfaces,
        world_to_ndc: &[[f32; 4]; 4],
        pixel_centre: [f32; 2],
    ) -> Result<Vec<f64>, ImageError> {
        check_same_size(left.extent, right.extent)?;
        check_same_size(left.extent, surfaces.extent())?;
        let [width, height] = [left.extent.width, left.extent.height].map(|n| n as usize);
        let of_surface: Vec<Option<f64>> = (0..left.extent.area())
            .map(|i| {
                let [x, _] = surfaces.point_in_other_eye(i, world_to_ndc, pixel_centre)?;
                Some((i % width) as f64 - x)
            })
            .collect();
        let most = of_surface.iter().flatten().copied().fold(0.0, f64::max).min(f64::from(FARTHEST)).ceil() as i32;
        let [references, images] = [
            Eyes { left: &left.reference, right: &right.reference, width },
            Eyes { left: &left.image, right: &right.image, width },
        ];
        let columns = || (BLOCK[0]..width.saturating_sub(BLOCK[0])).step_by(STEP);
        let rows = (BLOCK[1]..height.saturating_sub(BLOCK[1])).step_by(STEP);
        let mut off = Vec::new();
        for at in rows.flat_map(|y| columns().map(move |x| [x, y])) {
            let Some(surface) = one_surface(&of_surface, at, width) else { continue };
            let Some(expected) = references.feature(at, -2, most + 2) else { continue };
            if (expected - surface).abs() <= LEAST_APART {
                continue;
            }
            let around = expected.round() as i32;
            // Near the border, the feature might be outside.
            if [around - REACH, around + REACH].iter().any(|d| images.unlike(at, *d).is_none()) {
                continue;
            }
            let found = images.best(at, around - REACH, around + REACH);
            off.push(found.map_or(f64::from(REACH), |(found, _)| (found - expected).abs().min(f64::from(REACH))));
        }
        Ok(off)
    }
}

/// Returns the pixels of the block around a pixel.
fn block([x, y]: [usize; 2], width: usize) -> impl Iterator<Item = usize> {
    let rows = y - BLOCK[1]..=y + BLOCK[1];
    rows.flat_map(move |y| (x - BLOCK[0]..=x + BLOCK[0]).map(move |x| y * width + x))
}

/// Returns the disparity of the surface at a block's centre; `None` if the block shows sky, or surfaces of different
/// disparities.
fn one_surface(disparities: &[Option<f64>], at: [usize; 2], width: usize) -> Option<f64> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in block(at, width) {
        let disparity = disparities[i]?;
        (low, high) = (low.min(disparity), high.max(disparity));
    }
    (high - low < LEAST_APART).then_some(disparities[at[1] * width + at[0]]).flatten()
}

/// Images of both eyes.
struct Eyes<'a> {
    left: &'a Side,
    right: &'a Side,
    width: usize,
}

impl Eyes<'_> {
    /// Returns the difference between a block of the left eye and the right eye's block at a disparity, in square display
    /// values; `None` if that is outside the image.
    fn unlike(&self, at: [usize; 2], disparity: i32) -> Option<f64> {
        let x = i32::try_from(at[0]).ok()? - disparity;
        let reach = BLOCK[0] as i32;
        if x < reach || x + reach >= self.width as i32 {
            return None;
        }
        let square = |i: usize| {
            let other = (i as i64 - i64::from(disparity)) as usize;
            let (a, b) = (self.left.shown[i], self.right.shown[other]);
            (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>()
        };
        Some(block(at, self.width).map(square).sum())
    }

    /// Returns the disparity at which the right eye's block is most like a block of the left eye, and their difference.
    /// `None` if it is at an end of the range.
    fn best(&self, at: [usize; 2], low: i32, high: i32) -> Option<(f64, f64)> {
        let all: Vec<(i32, f64)> = (low..=high).filter_map(|d| Some((d, self.unlike(at, d)?))).collect();
        let best = all.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1))?.0;
        let [before, (disparity, least), after] = [*all.get(best.checked_sub(1)?)?, all[best], *all.get(best + 1)?];
        let curvature = before.1 - 2.0 * least + after.1;
        let shift = if curvature > 0.0 { 0.5 * (before.1 - after.1) / curvature } else { 0.0 };
        Some((f64::from(disparity) + shift, least))
    }

    /// Returns the disparity of a feature in a block; `None` if the block has no contrast, no match or several.
    fn feature(&self, at: [usize; 2], low: i32, high: i32) -> Option<f64> {
        let pixels = block(at, self.width).count() as f64;
        let sums = |of: &dyn Fn([f64; 3]) -> f64| block(at, self.width).map(|i| of(self.left.shown[i])).sum::<f64>();
        let variance: f64 = (0..3).map(|c| sums(&|p| p[c] * p[c]) - sums(&|p| p[c]).powi(2) / pixels).sum();
        if variance < 3.0 * pixels * LEAST_CONTRAST * LEAST_CONTRAST {
            return None;
        }
        let (disparity, least) = self.best(at, low, high)?;
        // Noise of the reference makes blocks differ a little in any case.
        let limit = LEAST_UNIQUE * least.max(0.25 * MOST_UNLIKE * variance);
        let is_other = |d: &i32| (f64::from(*d) - disparity).abs() > 1.5;
        let is_unique = (low..=high).filter(is_other).all(|d| self.unlike(at, d).is_none_or(|other| other >= limit));
        (least <= MOST_UNLIKE * variance && is_unique).then_some(disparity)
    }
}

#[cfg(test)]
mod tests {
    use super::super::rivalry::tests::{CENTRE, image, surfaces, world_to_ndc};
    use super::*;

    /// A wall with spots of light that lie at some disparity, in an eye.
    fn spots(disparity: f64, eye: usize) -> crate::image::RgbImage {
        let shift = if eye == 0 { 0.0 } else { disparity };
        image(move |x, y| {
            let at = |cx: f64, cy: f64| {
                let (dx, dy) = (x as f64 + shift - cx, y as f64 - cy);
                (-(dx * dx + dy * dy) / 8.0).exp()
            };
            let light = 0.6 * (at(12.0, 15.0) + at(20.3, 32.0) + at(14.6, 47.0));
            [0.2 + light; 3]
        })
    }

    fn off(reference: f64, found: f64) -> FeatureDisparity {
        let pair = |eye| Pair::new(&spots(reference, eye), &spots(found, eye), 0.0).unwrap();
        let errors = FeatureDisparity::errors(&pair(0), &pair(1), &surfaces(0), &world_to_ndc(1), CENTRE);
        FeatureDisparity::of_errors(errors.unwrap())
    }

    #[test]
    fn shifted_highlights_are_located_within_0_1_pixels() {
        // The wall's disparity is 2 pixels.
        for (reference, shift) in [(3.37, 0.0), (3.37, 0.3), (0.8, -0.45), (4.0, 1.2), (5.5, -0.75)] {
            let found = off(reference, reference + shift);
            assert!(found.features > 20, "{found:?}");
            for (value, most) in [(found.disparity_off, 0.1), (found.disparity_off_p95, 0.15)] {
                assert!((value.unwrap() - shift.abs()).abs() < most, "{reference} {shift}: {found:?}");
            }
        }
        assert_eq!(off(3.37, 9.0).disparity_off, Some(3.0), "what is not found counts as 3 px");
    }

    #[test]
    fn patterns_on_the_surface_are_no_features() {
        assert_eq!(off(2.0, 3.0), FeatureDisparity::default());
    }
}
