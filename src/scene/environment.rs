//! Environment images: latitude-longitude radiance from `.hdr` and `.exr` files.

use std::io::Cursor;
use std::path::Path;

use ::image::codecs::hdr::HdrDecoder;
use ::image::{ImageDecoder, ImageError as DecodeError};

use super::SceneError;
use super::budget::Budget;
use super::error::Fault;
use super::folder::{self, Access};
use crate::image::{Extent, Image, ImageError, RgbImage, exr};

const LARGEST_SIDE: u32 = 1 << 15;
const LONGEST_HEADER: usize = 1 << 16;
const LARGEST_AREA: usize = 1 << 28;

/// Reads the latitude-longitude image at `path` and multiplies it by `scale`. Returns the image, and the number of
/// pixels with invalid radiance (negative, NaN, infinite), which becomes 0. The image's bytes stay reserved in the
/// budget of `access`.
///
/// # Errors
/// [`SceneError::Read`], [`SceneError::Image`] or [`SceneError::Invalid`] for a file that can't be decoded,
/// [`SceneError::Refused`] for one that exceeds the budget.
pub fn read_latlong(path: &Path, scale: f32, access: Access) -> Result<(RgbImage, usize), SceneError> {
    let name = || path.display().to_string();
    let budget = access.budget;
    let file = folder::read(path, access).map_err(|error| error.in_file(path))?;
    let is_hdr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("hdr"));
    let mut image = if is_hdr { read_hdr(&name(), &file, budget)? } else { read_exr(path, &file, budget)? };
    let mut bad_pixels = 0;
    for pixel in &mut image.pixels {
        let scaled = pixel.map(|v| v * scale);
        let radiance = scaled.map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
        bad_pixels += usize::from(scaled != radiance);
        *pixel = radiance;
    }
    Ok((image, bad_pixels))
}

/// Bytes per pixel of the decoded image.
const PIXEL_BYTES: usize = size_of::<[f32; 3]>();

fn read_exr(path: &Path, bytes: &[u8], budget: &Budget) -> Result<RgbImage, SceneError> {
    let name = path.display().to_string();
    let image = exr::decode_rgb(path, bytes, budget.left()).map_err(|error| match error {
        ImageError::TooLarge { needed, .. } => match budget.reserve(needed) {
            Err(exceeded) => Fault::from(exceeded).in_file(&name),
            Ok(_) => error.into(),
        },
        other => other.into(),
    })?;
    budget
        .reserve((image.extent.area() * PIXEL_BYTES) as u64)
        .map_err(|error| Fault::from(error).in_file(&name))?
        .keep();
    Ok(image)
}

fn read_hdr(name: &str, bytes: &[u8], budget: &Budget) -> Result<RgbImage, SceneError> {
    let invalid = |what: String| SceneError::Invalid { path: name.to_owned(), what };
    let decode_error = |error: DecodeError| match error {
        DecodeError::IoError(source) => SceneError::Read { path: name.to_owned(), source },
        other => invalid(other.to_string()),
    };
    // The decoder keeps all header lines, which take more memory than their length.
    let header = &bytes[..bytes.len().min(LONGEST_HEADER)];
    if !header.windows(2).any(|pair| pair == b"\n\n") {
        if header.windows(4).any(|four| four == b"\r\n\r\n") {
            let what =
                "its lines end in CR LF, but those of a Radiance file end in LF: a transfer as text has changed it";
            return Err(invalid(format!("{what}, so copy it again as a binary file")));
        }
        return Err(invalid(format!("its header has no end within {LONGEST_HEADER} bytes")));
    }
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(decode_error)?;
    let (width, height) = decoder.dimensions();
    let (sides, extent) = (1..=LARGEST_SIDE, Extent::new(width, height));
    if !sides.contains(&width) || !sides.contains(&height) || extent.area() > LARGEST_AREA {
        return Err(invalid(format!(
            "its size is {extent}: give sides of 1 to {LARGEST_SIDE} pixels and at most {LARGEST_AREA} pixels in total"
        )));
    }
    let reserved =
        budget.reserve((extent.area() * PIXEL_BYTES) as u64).map_err(|error| Fault::from(error).in_file(name))?;
    let mut image = Image::filled(extent, [0.0; 3]);
    decoder.read_image(bytemuck::cast_slice_mut(&mut image.pixels)).map_err(decode_error)?;
    reserved.keep();
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a 2x1 Radiance file with the pixels 1, 0.5, 0 and 4, 4, 4.
    fn hdr_bytes() -> Vec<u8> {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
        bytes.extend([128, 64, 0, 129, 128, 128, 128, 131]);
        bytes
    }

    #[test]
    fn radiance_files_are_read_and_scaled() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.HDR");
        std::fs::write(&path, hdr_bytes()).unwrap();
        let (image, bad) = read_latlong(&path, 2.0, Access::of(&Budget::unlimited())).unwrap();
        assert_eq!(image.extent, Extent::new(2, 1));
        assert_eq!(image.pixels, [[2.0, 1.0, 0.0], [8.0, 8.0, 8.0]]);
        assert_eq!(bad, 0);
    }

    #[test]
    fn invalid_pixels_of_exr_skies_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.exr");
        let pixels = vec![[1.0, 2.0, 3.0], [f32::NAN, 1.0, 1.0], [-1.0, f32::INFINITY, 2.0]];
        let image = RgbImage { extent: Extent::new(3, 1), pixels };
        exr::write_rgb(&path, &image).unwrap();
        let (image, bad) = read_latlong(&path, 0.5, Access::of(&Budget::unlimited())).unwrap();
        assert_eq!(image.pixels, [[0.5, 1.0, 1.5], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]]);
        assert_eq!(bad, 2);
    }

    #[test]
    fn rejects_skies_with_windows_line_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.hdr");
        let bytes: Vec<u8> =
            hdr_bytes().into_iter().flat_map(|b| if b == b'\n' { vec![b'\r', b'\n'] } else { vec![b] }).collect();
        std::fs::write(&path, bytes).unwrap();
        let error = read_latlong(&path, 1.0, Access::of(&Budget::unlimited())).unwrap_err().to_string();
        assert!(error.contains("sky.hdr") && error.contains("CR LF") && error.contains("binary"), "{error}");
    }

    #[test]
    fn rejects_damaged_radiance_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.hdr");
        let whole = hdr_bytes();
        for cut in 0..whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let error = read_latlong(&path, 1.0, Access::of(&Budget::unlimited())).unwrap_err().to_string();
            assert!(error.contains("sky.hdr"), "{error}");
        }
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4000000000 +X 4000000000\n";
        std::fs::write(&path, huge).unwrap();
        assert!(
            read_latlong(&path, 1.0, Access::of(&Budget::unlimited())).unwrap_err().to_string().contains("4000000000x")
        );
    }
}
