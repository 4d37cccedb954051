//! Decoding of PNG, JPEG and WebP images to 8-bit RGBA texels, without colour conversion.

use std::io::Cursor;
use std::ops::RangeInclusive;

use ::image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::fault::{Fault, Outcome};
use crate::image::{Extent, Image};
use crate::scene::TexelImage;
use crate::scene::budget::Budget;

/// Maximum width and height of an image in pixels.
const MAX_SIDE: u32 = 16384;

/// Maximum compression ratio of deflate, which bounds the decompressed size of a PNG's metadata; then the minimum and
/// the maximum number of bytes to reserve for metadata.
const DEFLATE_GAIN: u64 = 1032;
const METADATA_BYTES: RangeInclusive<u64> = 1 << 20..=64 << 20;

/// Upper bound on the bytes per pixel during decoding: two for each of a progressive JPEG's four channels, the
/// decoder's output, and its conversion to RGBA.
const DECODING_BYTES: u64 = 24;

/// Decodes an image. The texels' bytes stay reserved in the budget.
pub fn decode(bytes: &[u8], budget: &Budget) -> Outcome<TexelImage> {
    let fault = |what: String| Fault::Invalid(format!("it cannot be decoded: {what}"));
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| fault(e.to_string()))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) {
        return Err(fault(format!("its {} bytes are not a PNG, JPEG or WebP image", bytes.len())));
    }
    let metadata_bytes = DEFLATE_GAIN.saturating_mul(bytes.len() as u64);
    let metadata = budget.reserve(metadata_bytes.clamp(*METADATA_BYTES.start(), *METADATA_BYTES.end()))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(metadata.bytes());
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| fault(e.to_string()))?;
    let (width, height) = decoder.dimensions();
    let extent = Extent::new(width, height);
    // The JPEG decoder keeps a copy of the file.
    let mut reserved = budget.reserve(extent.area() as u64 * DECODING_BYTES + bytes.len() as u64)?;
    let rgba = DynamicImage::from_decoder(decoder).map_err(|e| fault(e.to_string()))?.into_rgba8();
    let pixels = rgba.as_raw().as_chunks::<4>().0.to_vec();
    reserved.shrink_to(size_of_val(&*pixels) as u64);
    reserved.keep();
    Ok(Image { extent, pixels })
}
