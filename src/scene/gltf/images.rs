//! Decodes PNG, JPEG and WebP images to 8-bit RGBA texels, without conversion of colour.

use std::io::Cursor;
use std::ops::RangeInclusive;

use ::image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::fault::{Fault, Outcome};
use crate::image::{Extent, Image};
use crate::scene::TexelImage;
use crate::scene::budget::Budget;

/// Longest side, pixels.
const MAX_SIDE: u32 = 16384;

/// Deflate gains no more than this, so that what a PNG says about itself takes no more beside its texels; and what it may
/// take at most and in any case, bytes.
const DEFLATE_GAIN: u64 = 1032;
const METADATA_BYTES: RangeInclusive<u64> = 1 << 20..=64 << 20;

/// Bytes that a pixel takes while it is decoded, at most: two for each of a progressive JPEG's four channels, what comes
/// out of the decoder, and that as RGBA.
const DECODING_BYTES: u64 = 24;

/// The texels' part of the budget is taken for good.
pub fn decode(bytes: &[u8], budget: &Budget) -> Outcome<TexelImage> {
    let fault = |what: String| Fault::Invalid(format!("it does not decode: {what}"));
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| fault(e.to_string()))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) {
        return Err(fault(format!("its {} bytes are no PNG, JPEG or WebP", bytes.len())));
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
    // JPEG's decoder has a copy of the file.
    let mut reserved = budget.reserve(extent.area() as u64 * DECODING_BYTES + bytes.len() as u64)?;
    let rgba = DynamicImage::from_decoder(decoder).map_err(|e| fault(e.to_string()))?.into_rgba8();
    let pixels = rgba.as_raw().as_chunks::<4>().0.to_vec();
    reserved.shrink_to(size_of_val(&*pixels) as u64);
    reserved.keep();
    Ok(Image { extent, pixels })
}
