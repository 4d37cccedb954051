//! Where the error is: a picture of per-pixel error.

use std::f64::consts::TAU;

use crate::image::display::{DisplayImage, display_value, level};
use crate::image::{Image, ImageError, RgbImage, check_same_size};

/// Colours each pixel by the root mean square, over its channels, of the difference of display values.
///
/// Black is equal, white is black against white. The scale is the square root of the error and the same for all
/// images, so that errors of a few levels can be told apart and two heatmaps can be compared.
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn heatmap(reference: &RgbImage, image: &RgbImage) -> Result<DisplayImage, ImageError> {
    check_same_size(reference.extent, image.extent)?;
    let colour = |(r, a): (&[f32; 3], &[f32; 3])| cubehelix(display_error(r, a).sqrt()).map(level);
    let pixels = reference
        .pixels
        .iter()
        .zip(&image.pixels)
        .map(colour)
        .collect();
    Ok(Image {
        extent: image.extent,
        pixels,
    })
}

fn display_error(r: &[f32; 3], a: &[f32; 3]) -> f64 {
    let squares = r
        .iter()
        .zip(a)
        .map(|(&r, &a)| (display_value(a.into()) - display_value(r.into())).powi(2));
    (squares.sum::<f64>() / 3.0).sqrt()
}

/// Display colour at 0 … 1 of the cubehelix scheme (Green 2011, Bull. Astron. Soc. India 39, eq. 2) with its usual
/// start 0.5, -1.5 rotations and hue 1: a helix around the grey axis whose perceived intensity is the position.
fn cubehelix(position: f64) -> [f64; 3] {
    let angle = TAU * (0.5 / 3.0 - 1.5 * position);
    let amplitude = position * (1.0 - position) / 2.0;
    let (sin, cos) = angle.sin_cos();
    [(-0.14861, 1.78277), (-0.29227, -0.90649), (1.97294, 0.0)]
        .map(|(along_cos, along_sin)| position + amplitude * (along_cos * cos + along_sin * sin))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;

    #[test]
    fn equal_is_black_and_opposite_is_white() {
        let extent = Extent::new(2, 1);
        let reference = Image {
            extent,
            pixels: vec![[0.3; 3], [0.0; 3]],
        };
        let image = Image {
            extent,
            pixels: vec![[0.3; 3], [f32::INFINITY; 3]],
        };
        assert_eq!(
            heatmap(&reference, &image).unwrap().pixels,
            [[0; 3], [255; 3]]
        );
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

    #[test]
    fn different_sizes_are_an_error() {
        let [a, b] = [1, 2].map(|w| RgbImage::filled(Extent::new(w, 1), [0.0; 3]));
        assert!(heatmap(&a, &b).is_err());
    }
}
