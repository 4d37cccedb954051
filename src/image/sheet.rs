//! Contact sheets: many images in one.

use super::display::{DisplayImage, level, linear_from_srgb, srgb_from_linear};
use super::{Extent, Image, ImageError, check_same_size, stereo};

/// Gap between images in pixels.
const GAP: u32 = 4;

/// Shrinks an image by the smallest integer factor that leaves at most `width` columns. Box-filters linear light and
/// drops incomplete blocks at the right and at the bottom.
pub fn reduced(picture: &DisplayImage, width: u32) -> DisplayImage {
    let factor = picture.extent.width.div_ceil(width.max(1)).clamp(1, picture.extent.height.max(1));
    let extent = Extent::new(picture.extent.width / factor, picture.extent.height / factor);
    let area = f64::from(factor * factor);
    let pixel = |x: u32, y: u32| -> [u8; 3] {
        std::array::from_fn(|c| {
            let cells = (0..factor).flat_map(|j| (0..factor).map(move |i| (i, j)));
            let codes = cells.map(|(i, j)| picture.get(x * factor + i, y * factor + j)[c]);
            let sum: f64 = codes.map(|code| linear_from_srgb(f64::from(code) / 255.0)).sum();
            level(srgb_from_linear(sum / area))
        })
    };
    Image::from_fn(extent, pixel)
}

/// Puts the pictures of all views of a rig into one: two eyes side by side, more views in rows of four.
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn of_views(pictures: &[DisplayImage]) -> Result<DisplayImage, ImageError> {
    match pictures {
        [left, right] => stereo::side_by_side(left, right),
        _ => contact_sheet(pictures, 4),
    }
}

/// Arranges images of the same size in a grid with `columns` columns, row by row from the top left, on black.
///
/// # Errors
/// [`ImageError::SizeMismatch`].
pub fn contact_sheet(pictures: &[DisplayImage], columns: usize) -> Result<DisplayImage, ImageError> {
    let columns = columns.clamp(1, pictures.len().max(1));
    let one = pictures.first().map_or(Extent::new(1, 1), |p| p.extent);
    let rows = pictures.len().div_ceil(columns).max(1);
    let across = |count: usize, size: u32| count as u32 * (size + GAP) - GAP;
    let mut sheet = Image::filled(Extent::new(across(columns, one.width), across(rows, one.height)), [0; 3]);
    let width = sheet.extent.width as usize;
    for (i, picture) in pictures.iter().enumerate() {
        check_same_size(one, picture.extent)?;
        let left = (i % columns) * (one.width + GAP) as usize;
        let top = (i / columns) * (one.height + GAP) as usize;
        for y in one.rows() {
            let at = (top + y as usize) * width + left;
            sheet.pixels[at..at + one.width as usize].copy_from_slice(picture.rows(y..y + 1));
        }
    }
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contact_sheet_places_pictures_in_rows() {
        let pictures: Vec<_> = (1..=3).map(|v| DisplayImage::filled(Extent::new(2, 1), [v; 3])).collect();
        let sheet = contact_sheet(&pictures, 2).unwrap();
        assert_eq!(sheet.extent, Extent::new(2 + GAP + 2, 1 + GAP + 1));
        let at = |x, y| sheet.get(x, y)[0];
        assert_eq!([at(0, 0), at(1, 0), at(2, 0), at(2 + GAP, 0)], [1, 1, 0, 2]);
        assert_eq!([at(0, 1 + GAP), at(2 + GAP, 1 + GAP)], [3, 0]);
        let other = DisplayImage::filled(Extent::new(1, 1), [0; 3]);
        assert!(contact_sheet(&[pictures[0].clone(), other], 2).is_err());
    }

    #[test]
    fn smaller_pictures_have_the_mean_light() {
        let pixels = vec![[0; 3], [255; 3], [9; 3], [255; 3], [0; 3], [9; 3]];
        let small = reduced(&Image { extent: Extent::new(3, 2), pixels }, 1);
        assert_eq!((small.extent, &small.pixels[..]), (Extent::new(1, 1), &[[188; 3]][..]));
        let same = DisplayImage::filled(Extent::new(2, 2), [7; 3]);
        assert_eq!(reduced(&same, 2).pixels, same.pixels);
    }
}
