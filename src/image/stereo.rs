//! Combines both eyes' images in one image: side by side, one above the other, or as an anaglyph.

use super::display::DisplayImage;
use super::{Extent, Image, ImageError, check_same_size};

/// Puts the left eye's image on the left and the right eye's on the right (parallel viewing).
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn side_by_side<T: Clone>(left: &Image<T>, right: &Image<T>) -> Result<Image<T>, ImageError> {
    check_same_size(left.extent, right.extent)?;
    let Extent { width, height } = left.extent;
    let pixels = left.extent.rows().flat_map(|y| [left.rows(y..y + 1), right.rows(y..y + 1)]).flatten();
    Ok(Image { extent: Extent::new(2 * width, height), pixels: pixels.cloned().collect() })
}

/// Puts the image of the leftmost view beside that of the rightmost one, if it is another; see [`side_by_side`].
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn outer<T: Clone>(views: &[Image<T>]) -> Result<Image<T>, ImageError> {
    match views {
        [only] => Ok(only.clone()),
        [left, .., right] => side_by_side(left, right),
        [] => Ok(Image { extent: Extent::new(0, 0), pixels: Vec::new() }),
    }
}

/// Puts the left eye's image above the right eye's.
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn over_under<T: Clone>(left: &Image<T>, right: &Image<T>) -> Result<Image<T>, ImageError> {
    check_same_size(left.extent, right.extent)?;
    let Extent { width, height } = left.extent;
    Ok(Image { extent: Extent::new(width, 2 * height), pixels: [&left.pixels[..], &right.pixels].concat() })
}

/// Makes a half-colour anaglyph for red-cyan glasses: red is the left eye's luma; green and blue are the right eye's.
///
/// Luma (Rec. ITU-R BT.601) instead of the left eye's red keeps saturated reds and cyans from being bright to one eye
/// and black to the other. Reds become paler.
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn anaglyph(left: &DisplayImage, right: &DisplayImage) -> Result<DisplayImage, ImageError> {
    check_same_size(left.extent, right.extent)?;
    let pixels = left.pixels.iter().zip(&right.pixels).map(|(l, r)| [luma(*l), r[1], r[2]]).collect();
    Ok(Image { extent: left.extent, pixels })
}

fn luma([r, g, b]: [u8; 3]) -> u8 {
    (0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_holds_the_left_row_then_the_right_row() {
        let extent = Extent::new(2, 2);
        let left = Image { extent, pixels: vec![1, 2, 3, 4] };
        let right = Image { extent, pixels: vec![5, 6, 7, 8] };
        let both = side_by_side(&left, &right).unwrap();
        assert_eq!(both.extent, Extent::new(4, 2));
        assert_eq!(both.pixels, [1, 2, 5, 6, 3, 4, 7, 8]);
        let stacked = over_under(&left, &right).unwrap();
        assert_eq!((stacked.extent, stacked.pixels), (Extent::new(2, 4), vec![1, 2, 3, 4, 5, 6, 7, 8]));
    }

    #[test]
    fn each_eye_reaches_only_its_own_glass() {
        let extent = Extent::new(1, 1);
        let [black, white] = [0, 255].map(|v| DisplayImage::filled(extent, [v; 3]));
        assert_eq!(anaglyph(&white, &black).unwrap().pixels, [[255, 0, 0]]);
        assert_eq!(anaglyph(&black, &white).unwrap().pixels, [[0, 255, 255]]);
    }

    #[test]
    fn anaglyph_shows_red_to_the_left_eye_as_luma() {
        let red = DisplayImage::filled(Extent::new(1, 1), [255, 0, 0]);
        assert_eq!(anaglyph(&red, &red).unwrap().pixels, [[76, 0, 0]]);
    }

    #[test]
    fn rejects_eyes_of_different_sizes() {
        let a = DisplayImage::filled(Extent::new(2, 1), [0; 3]);
        let b = DisplayImage::filled(Extent::new(1, 2), [0; 3]);
        for message in [side_by_side(&a, &b).unwrap_err().to_string(), anaglyph(&a, &b).unwrap_err().to_string()] {
            assert!(message.contains("2x1 and 1x2"), "{message}");
        }
    }
}
