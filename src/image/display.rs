//! Tone mapping from linear radiance to display values: a tone curve, then the sRGB curve.

use std::io::{self, Write};
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder};

use super::file::atomic_write;
use super::tone::ToneCurve;
use super::{Image, ImageError, RgbImage};

/// An sRGB-encoded image with 8 bits per channel.
pub type DisplayImage = Image<[u8; 3]>;

/// Maps radiance 0 … ∞ to a display value 0 … 1: c/(1+c) (Reinhard et al. 2002, eq. 3, per channel), then the sRGB
/// curve (IEC 61966-2-1). Negative radiance and NaN map to 0.
pub fn display_value(radiance: f64) -> f64 {
    let c = radiance.max(0.0);
    srgb_from_linear(if c.is_infinite() { 1.0 } else { c / (1.0 + c) })
}

/// Returns the Rec. 709 luminance of a linear colour.
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    r * 0.2126 + g * 0.7152 + b * 0.0722
}

/// Returns the exposure in stops that makes the geometric mean of the picture's radiances mid-grey; black pixels are
/// ignored.
pub fn mid_grey_ev(image: &RgbImage) -> f64 {
    const MID_GREY: f64 = 0.18;
    let radiances = image.pixels.iter().map(|p| p.iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0);
    let logs: Vec<f64> = radiances.filter(|r| *r > 0.0 && r.is_finite()).map(f64::log2).collect();
    if logs.is_empty() { 0.0 } else { MID_GREY.log2() - logs.iter().sum::<f64>() / logs.len() as f64 }
}

/// Applies the sRGB curve to 0 … 1.
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Applies the inverse of the sRGB curve to 0 … 1.
pub fn linear_from_srgb(display: f64) -> f64 {
    if display <= 0.04045 { display / 12.92 } else { ((display + 0.055) / 1.055).powf(2.4) }
}

/// Returns the 8-bit level nearest to a display value, which is clamped to 0 … 1.
pub fn level(display: f64) -> u8 {
    (display.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Returns the factor that scales radiance for display: 2 to the power of the exposure in stops.
pub fn gain(exposure_ev: f32) -> f64 {
    f64::from(exposure_ev).exp2()
}

/// Scales each channel by [`gain`], applies the tone curve and the sRGB curve, and rounds to 8 bits.
pub fn tonemap(image: &RgbImage, exposure_ev: f32, tone: ToneCurve) -> DisplayImage {
    let gain = gain(exposure_ev);
    let shown = |p: &[f32; 3]| tone.apply(p.map(|c| f64::from(c) * gain)).map(|c| level(srgb_from_linear(c)));
    Image { extent: image.extent, pixels: image.pixels.iter().map(shown).collect() }
}

/// Writes an 8-bit RGB PNG.
///
/// # Errors
/// [`ImageError::Write`].
pub fn write_png(path: &Path, image: &DisplayImage) -> Result<(), ImageError> {
    atomic_write(path, |file| encode_png(image, file))
}

/// Encodes an 8-bit RGB PNG.
///
/// # Errors
/// An error of the writer `to`.
pub fn encode_png(image: &DisplayImage, to: impl Write) -> io::Result<()> {
    PngEncoder::new_with_quality(to, CompressionType::Fast, FilterType::Adaptive)
        .write_image(image.pixels.as_flattened(), image.extent.width, image.extent.height, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::super::Extent;
    use super::*;

    #[test]
    fn radiances_map_to_reference_levels() {
        // The sRGB curve encodes c/(1+c) = 0.5 as 0.735357 (IEC 61966-2-1); 0.002/1.002 lies on its linear part.
        for (radiance, display) in [
            (0.0, 0.0),
            (1.0, 0.735_356_983_052_449),
            (0.002, 12.92 * 0.002 / 1.002),
            (f64::INFINITY, 1.0),
            (-3.0, 0.0),
            (f64::NAN, 0.0),
        ] {
            assert!((display_value(radiance) - display).abs() < 1e-12, "{radiance}");
        }
        assert_eq!([0.0, 1.0, 0.5, -1.0, 2.0, 0.735_357].map(level), [0, 255, 128, 0, 255, 188]);
    }

    #[test]
    fn srgb_curve_is_continuous_and_invertible() {
        let knee = 0.0031308;
        assert!((srgb_from_linear(knee) - srgb_from_linear(knee * (1.0 + 1e-9))).abs() < 1e-7);
        assert!((srgb_from_linear(1.0) - 1.0).abs() < 1e-15);
        for linear in [0.0, 0.001, 0.003, 0.0032, 0.2, 1.0] {
            assert!((linear_from_srgb(srgb_from_linear(linear)) - linear).abs() < 1e-15, "{linear}");
        }
    }

    #[test]
    fn one_ev_doubles_the_radiance() {
        let extent = Extent::new(1, 1);
        let one = tonemap(&Image::filled(extent, [0.4, 1.0, 3.0]), 0.0, ToneCurve::Reinhard);
        let half = tonemap(&Image::filled(extent, [0.2, 0.5, 1.5]), 1.0, ToneCurve::Reinhard);
        assert_eq!(one, half);
        assert_eq!(one.pixels[0][1], 188);
    }

    #[test]
    fn png_keeps_display_levels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let extent = Extent::new(5, 3);
        let pixels = (0..15).map(|i| [i * 17, 255 - i, i]).collect();
        let image = DisplayImage { extent, pixels };
        write_png(&path, &image).unwrap();
        let back = ::image::open(&path).unwrap().into_rgb8();
        assert_eq!(back.dimensions(), (5, 3));
        assert_eq!(back.as_raw(), image.pixels.as_flattened());
    }
}
