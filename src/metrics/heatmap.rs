//! Heatmaps: false-colour images of per-pixel error.

use std::f64::consts::TAU;

use crate::image::Image;
use crate::image::display::{DisplayImage, level};

use super::Pair;

/// Colours each pixel by the RMS over channels of the difference of display values.
///
/// Equal pixels are black; black against white is white. The scale is the square root of the error, so that errors of a
/// few levels are visible, and is the same for all images, so that heatmaps can be compared. Values that are not finite
/// count as 0.
pub fn heatmap(pair: &Pair) -> DisplayImage {
    let pixels = (0..pair.extent.area()).map(|i| error_colour(rms(pair.display_error(i)))).collect();
    Image { extent: pair.extent, pixels }
}

/// Returns the colour of an error of display values, on the scale of [`heatmap`].
pub fn error_colour(error: f64) -> [u8; 3] {
    cubehelix(error.clamp(0.0, 1.0).sqrt()).map(level)
}

/// Returns the root mean square of a difference over channels.
pub(super) fn rms(difference: [f64; 3]) -> f64 {
    (difference.iter().map(|d| d * d).sum::<f64>() / 3.0).sqrt()
}

/// Returns the display colour at `position` 0 … 1 of the cubehelix scheme (Green 2011, Bull. Astron. Soc. India 39, eq.
/// 2) with its usual start 0.5, -1.5 rotations and hue 1: a helix around the grey axis with linearly rising perceived
/// intensity.
fn cubehelix(position: f64) -> [f64; 3] {
    let angle = TAU * (0.5 / 3.0 - 1.5 * position);
    let amplitude = position * (1.0 - position) / 2.0;
    let (sin, cos) = angle.sin_cos();
    [(-0.14861, 1.78277), (-0.29227, -0.90649), (1.97294, 0.0)]
        .map(|(along_cos, along_sin)| position + amplitude * (along_cos * cos + along_sin * sin))
}

/// Returns the colour of a number on the scale from 0 (black) to `most` (pale).
pub fn number_colour(number: f32, most: f32) -> [u8; 3] {
    // The last tenth is too close to white to distinguish.
    cubehelix(f64::from(number / most.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0) * 0.9).map(level)
}

/// Colours the FLIP of each pixel with the magma map, FLIP's usual one: 0 is black, 1 is pale yellow.
pub fn flip_heatmap(pair: &Pair) -> DisplayImage {
    let pixels = pair.flip().iter().map(|&flip| magma(flip).map(|c| c.round() as u8)).collect();
    Image { extent: pair.extent, pixels }
}

/// Returns the magma colour (van der Walt & Smith 2015, CC0) at `position` 0 … 1, in levels 0 … 255: linear
/// interpolation of 17 samples, at most 3 levels off.
fn magma(position: f64) -> [f64; 3] {
    const STEPS: usize = 16;
    const STOPS: [[u8; 3]; STEPS + 1] = [
        [0, 0, 4],
        [10, 8, 34],
        [29, 17, 71],
        [54, 16, 107],
        [81, 18, 124],
        [106, 28, 129],
        [131, 38, 129],
        [156, 46, 127],
        [183, 55, 121],
        [207, 64, 112],
        [229, 80, 100],
        [244, 105, 92],
        [251, 135, 97],
        [254, 165, 113],
        [254, 194, 135],
        [253, 224, 161],
        [252, 253, 191],
    ];
    let at = position.clamp(0.0, 1.0) * STEPS as f64;
    let below = (at as usize).min(STEPS - 1);
    let t = at - below as f64;
    std::array::from_fn(|c| f64::from(STOPS[below][c]) * (1.0 - t) + f64::from(STOPS[below + 1][c]) * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;

    #[test]
    fn equal_is_black_and_opposite_is_white() {
        let extent = Extent::new(2, 1);
        let reference = Image { extent, pixels: vec![[0.3; 3], [0.0; 3]] };
        let image = Image { extent, pixels: vec![[0.3; 3], [f32::MAX; 3]] };
        assert_eq!(heatmap(&Pair::new(&reference, &image, 0.0).unwrap()).pixels, [[0; 3], [255; 3]]);
    }

    #[test]
    fn intensity_grows_with_the_error() {
        let intensity = |i: u32| {
            let [r, g, b] = cubehelix(f64::from(i) / 100.0);
            0.30 * r + 0.59 * g + 0.11 * b
        };
        for i in 0..100 {
            assert!((intensity(i) - f64::from(i) / 100.0).abs() < 1e-3, "{i}");
        }
    }

    /// Levels 40, 100 and 200 of 255, as `flip_evaluator` 1.7 colours them.
    #[test]
    fn magma_matches_the_colours_of_flip() {
        for (level, colour) in [(40, [41, 17, 90]), (100, [137, 40, 129]), (200, [253, 152, 105])] {
            let found = magma(f64::from(level) / 255.0);
            assert!((0..3).all(|c| (found[c] - f64::from(colour[c])).abs() <= 3.0), "{level}: {found:?}");
        }
        assert_eq!([-1.0, 0.0, 1.0, 2.0].map(magma).map(|c| c[2]), [4.0, 4.0, 191.0, 191.0]);
    }
}
