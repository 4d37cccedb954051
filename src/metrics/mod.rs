//! Image quality: errors of an image against its reference.
//!
//! Sums are f64. RMSE, relMSE, the mean ratio and the block error use linear radiance. PSNR, SSIM and FLIP use [display
//! values](crate::image::display::display_value), 0 … 1, which weigh bright noise as it is perceived. They depend on
//! the exposure, which a [`Pair`] fixes.

mod cambi;
mod convolve;
pub mod disparity;
pub mod error;
pub mod flip;
mod foveated;
pub mod heatmap;
pub mod kinds;
pub mod rings;
pub mod rivalry;
pub mod seams;
pub mod ssim;
pub mod surfaces;
pub mod temporal;

use std::fmt;

use serde::Serialize;

use crate::image::display::{DisplayImage, display_value, gain, linear_from_srgb};
use crate::image::{Extent, Image, ImageError, RgbImage, check_same_size};

/// Errors of an image against its reference.
///
/// In JSON, undefined values and the infinite PSNR of equal images are `null`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Errors {
    pub rmse: f64,
    pub relmse: f64,
    /// PSNR in dB; infinite for equal images.
    pub psnr: f64,
    /// Mean SSIM; `None` for an image with a side shorter than the window, 11 pixels.
    pub ssim: Option<f64>,
    /// Mean of [`flip::flip_map`].
    pub flip: f64,
    /// Ratio mean(image) / mean(reference); `None` if the reference is black.
    pub mean_ratio: Option<f64>,
    /// RMSE of 16x16 block means over the mean of the reference; `None` for a black reference or without a whole block.
    pub block16: Option<f64>,
    /// Number of pixels with a NaN or an infinity. The errors above treat such values as 0.
    pub nonfinite_px: usize,
    pub nonfinite_reference_px: usize,
}

/// Name and meaning of each field of [`Errors`], in order.
pub const MEASURES: [(&str, &str); 9] = [
    ("rmse", "root mean square error of linear radiance; 0 is best"),
    ("relmse", "mean of error² / (reference² + 0.01), linear radiance; 0 is best"),
    ("psnr", "peak signal-to-noise ratio, tonemapped, dB; higher is better, inf if equal"),
    ("ssim", "structural similarity of tonemapped values; 1 if equal"),
    ("flip", "difference seen when flipping from one to the other; 0 is none, 1 the most"),
    ("mean_ratio", "mean of the image over mean of the reference; 1 if equally bright"),
    ("block16", "RMSE of 16x16 block means over the mean: low-frequency error; 0 is best"),
    ("nonfinite_px", "pixels of the image with a NaN or an infinity, which count as 0"),
    ("nonfinite_reference_px", "the same for pixels of the reference"),
];

/// Returns all errors of `image` against `reference` at 0 EV; [`Pair::new`] takes another exposure.
///
/// # Errors
/// [`ImageError::SizeMismatch`], [`ImageError::NoPixels`].
pub fn compare(reference: &RgbImage, image: &RgbImage) -> Result<Errors, ImageError> {
    Ok(Pair::new(reference, image, 0.0)?.errors())
}

/// An image and its reference at one exposure, with intermediate results that several errors share.
pub struct Pair {
    extent: Extent,
    reference: Side,
    image: Side,
    /// FLIP of each pixel.
    flip: Vec<f64>,
}

struct Side {
    /// Linear radiance, with 0 for non-finite values.
    radiance: Vec<[f64; 3]>,
    /// Display values.
    shown: Vec<[f64; 3]>,
    nonfinite_px: usize,
}

impl Side {
    /// Takes the levels of a picture as display values, and decodes them from sRGB to radiance.
    fn of_picture(picture: &DisplayImage) -> Self {
        let shown: Vec<[f64; 3]> = picture.pixels.iter().map(|p| p.map(|level| f64::from(level) / 255.0)).collect();
        Self { radiance: shown.iter().map(|p| p.map(linear_from_srgb)).collect(), shown, nonfinite_px: 0 }
    }

    fn new(image: &RgbImage, exposure_ev: f32) -> Self {
        let gain = gain(exposure_ev);
        let finite = |c: f32| if c.is_finite() { f64::from(c) } else { 0.0 };
        let radiance: Vec<_> = image.pixels.iter().map(|p| p.map(finite)).collect();
        let shown = radiance.iter().map(|p| p.map(|c| display_value(c * gain))).collect();
        let nonfinite_px = image.pixels.iter().filter(|p| p.iter().any(|c| !c.is_finite())).count();
        Self { radiance, shown, nonfinite_px }
    }
}

impl Errors {
    /// Returns the values in the order of [`MEASURES`].
    pub fn values(&self) -> [Option<f64>; 9] {
        [
            Some(self.rmse),
            Some(self.relmse),
            Some(self.psnr),
            self.ssim,
            Some(self.flip),
            self.mean_ratio,
            self.block16,
            Some(self.nonfinite_px as f64),
            Some(self.nonfinite_reference_px as f64),
        ]
    }
}

impl Pair {
    /// Prepares a pair for display at an exposure of `exposure_ev` stops.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`], [`ImageError::NoPixels`].
    pub fn new(reference: &RgbImage, image: &RgbImage, exposure_ev: f32) -> Result<Self, ImageError> {
        Self::of_sides([reference, image], |side| Side::new(side, exposure_ev))
    }

    /// Prepares a pair of sRGB pictures. Their levels are the display values, and errors of radiance are those of the
    /// decoded levels, from 0 to 1.
    ///
    /// # Errors
    /// Errors of [`Self::new`].
    pub fn of_pictures(reference: &DisplayImage, image: &DisplayImage) -> Result<Self, ImageError> {
        Self::of_sides([reference, image], Side::of_picture)
    }

    fn of_sides<T>(images: [&Image<T>; 2], side: impl Fn(&Image<T>) -> Side) -> Result<Self, ImageError> {
        let extent = images[0].extent;
        check_same_size(extent, images[1].extent)?;
        if extent.area() == 0 {
            return Err(ImageError::NoPixels(extent));
        }
        let [reference, image] = images.map(side);
        let flip = flip::flip_map(extent, &reference.shown, &image.shown);
        Ok(Self { extent, reference, image, flip })
    }

    pub fn errors(&self) -> Errors {
        let (r, a) = (&self.reference, &self.image);
        Errors {
            rmse: error::rmse(&r.radiance, &a.radiance),
            relmse: error::relmse(&r.radiance, &a.radiance),
            psnr: error::psnr(&r.shown, &a.shown),
            ssim: ssim::ssim(self.extent, &r.shown, &a.shown),
            flip: error::mean(self.flip.iter().copied()),
            mean_ratio: error::mean_ratio(&r.radiance, &a.radiance),
            block16: error::block_error(self.extent, 16, &r.radiance, &a.radiance),
            nonfinite_px: a.nonfinite_px,
            nonfinite_reference_px: r.nonfinite_px,
        }
    }

    /// FLIP of each pixel, row-major, 0 … 1.
    pub fn flip(&self) -> &[f64] {
        &self.flip
    }
}

/// Formats one `name value` line per measure.
impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |value: Option<f64>| value.map_or("undefined".to_owned(), |v| format!("{v:.6}"));
        let lines = MEASURES.iter().zip(self.values()).map(|((name, _), v)| format!("{name:<22} {:>12}", value(v)));
        f.write_str(&lines.collect::<Vec<_>>().join("\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    fn noise_image(extent: Extent, mut state: u32, scale: f32) -> RgbImage {
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 * scale
        };
        let pixels = (0..extent.area()).map(|_| [next(), next(), next()]).collect();
        Image { extent, pixels }
    }

    fn noisy_pair(extent: Extent) -> (RgbImage, RgbImage) {
        let reference = noise_image(extent, 1, 3.0);
        let mut image = noise_image(extent, 2, 1.0);
        let values = image.pixels.as_flattened_mut().iter_mut();
        for (a, r) in values.zip(reference.pixels.as_flattened()) {
            *a += r * 0.75;
        }
        (reference, image)
    }

    /// Values computed by scikit-image 0.26.0 (`structural_similarity` with `channel_axis=2, data_range=1,
    /// gaussian_weights=True, sigma=1.5, use_sample_covariance=False`) and NumPy in f64 on the same images.
    #[test]
    fn metrics_equal_scikit_image() {
        let (reference, image) = noisy_pair(Extent::new(37, 35));
        let found = compare(&reference, &image).unwrap();
        for (name, value, independent) in [
            ("rmse", found.rmse, 0.385_990_030_210_248_5),
            ("relmse", found.relmse, 1.717_573_581_147_473_5),
            ("psnr", found.psnr, 19.096_597_871_754_47),
            ("ssim", found.ssim.unwrap(), 0.723_888_622_605_714_5),
            ("mean_ratio", found.mean_ratio.unwrap(), 1.087_109_123_672_136_6),
            ("block16", found.block16.unwrap(), 0.088_890_859_420_416_29),
        ] {
            assert!((value / independent - 1.0).abs() < 1e-11, "{name}: {value}, independently {independent}");
        }
    }

    #[test]
    fn equal_images_have_no_error() {
        let (image, _) = noisy_pair(Extent::new(20, 18));
        let found = compare(&image, &image).unwrap();
        assert_eq!((found.rmse, found.relmse, found.psnr), (0.0, 0.0, f64::INFINITY));
        assert!((found.ssim.unwrap() - 1.0).abs() < 1e-12);
        assert_eq!((found.mean_ratio, found.block16, found.flip), (Some(1.0), Some(0.0), 0.0));
        assert!(found.to_string().contains("inf"), "{found}");
        assert!(serde_json::to_value(found).unwrap()["psnr"].is_null());
    }

    #[test]
    fn nonfinite_pixels_are_counted_as_black() {
        let extent = Extent::new(16, 16);
        let mut reference = RgbImage::filled(extent, [1.0; 3]);
        let mut image = reference.clone();
        reference.pixels[0] = [f32::NEG_INFINITY, 1.0, 1.0];
        image.pixels[0] = [f32::NAN, 1.0, 1.0];
        image.pixels[9] = [f32::INFINITY, f32::NAN, 1.0];
        let found = compare(&reference, &image).unwrap();
        assert_eq!((found.nonfinite_px, found.nonfinite_reference_px), (2, 1));
        assert!((found.rmse - (2.0f64 / (3.0 * 256.0)).sqrt()).abs() < 1e-15);
    }

    #[test]
    fn undefined_metrics_are_none() {
        let black = RgbImage::filled(Extent::new(10, 40), [0.0; 3]);
        let found = compare(&black, &black).unwrap();
        assert_eq!((found.ssim, found.mean_ratio, found.block16), (None, None, None));
        assert!(found.to_string().contains("undefined"), "{found}");
    }

    #[test]
    fn rejects_different_sizes_by_name() {
        let a = RgbImage::filled(Extent::new(2, 3), [0.0; 3]);
        let b = RgbImage::filled(Extent::new(3, 2), [0.0; 3]);
        let message = compare(&a, &b).unwrap_err().to_string();
        assert!(message.contains("2x3") && message.contains("3x2"), "{message}");
    }

    #[test]
    fn rejects_images_without_pixels() {
        for extent in [Extent::new(0, 3), Extent::new(3, 0)] {
            let empty = RgbImage::filled(extent, [0.0; 3]);
            assert!(matches!(compare(&empty, &empty), Err(ImageError::NoPixels(_))));
        }
    }
}
