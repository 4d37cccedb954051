//! Decoding of PNG, JPEG, WebP and KTX2 images to 8-bit RGBA texels, without colour conversion.

use std::io::Cursor;
use std::ops::RangeInclusive;

use ::image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use basisu::{DecodeFlags, TargetFormat, Transcoder};

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

/// First bytes of a KTX2 file.
const KTX2: &[u8] = b"\xABKTX 20\xBB\r\n\x1A\n";

/// Upper bound on the bytes per pixel during decoding of KTX2: the texels and the blocks, decompressed.
const KTX2_BYTES: u64 = 8;

/// Decodes an image. The texels' bytes stay reserved in the budget.
pub fn decode(bytes: &[u8], budget: &Budget) -> Outcome<TexelImage> {
    if bytes.starts_with(KTX2) {
        return decode_ktx2(bytes, budget);
    }
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| fault(e.to_string()))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) {
        return Err(fault(format!("its {} bytes are not a PNG, JPEG, WebP or KTX2 image", bytes.len())));
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

/// Decodes level 0 of a KTX2 image with Basis Universal's codecs, which is what `KHR_texture_basisu` allows.
fn decode_ktx2(bytes: &[u8], budget: &Budget) -> Outcome<TexelImage> {
    let _codebooks = budget.reserve(DEFLATE_GAIN.saturating_mul(bytes.len() as u64).min(*METADATA_BYTES.end()))?;
    let no_basis = |_| fault("it is damaged, or a KTX2 image without Basis Universal's codecs".into());
    let image = Transcoder::new(bytes).map_err(no_basis)?;
    let (width, height) = image.base_dimensions();
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(fault(format!("its {width} x {height} pixels are outside 1 to {MAX_SIDE} on a side")));
    }
    if image.face_count() > 1 || image.layer_count() > 1 || image.is_video() {
        return Err(fault("it is an array, a cube map or a video".into()));
    }
    if !image.supports(TargetFormat::Rgba32) {
        return Err(fault("it has high dynamic range".into()));
    }
    let extent = Extent::new(width, height);
    let mut reserved = budget.reserve(extent.area() as u64 * KTX2_BYTES)?;
    let texels = image.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE);
    let texels = texels.map_err(|e| fault(format!("{e:?}")))?;
    let pixels = texels.as_chunks::<4>().0.to_vec();
    if pixels.len() != extent.area() {
        return Err(fault(format!("it holds {} of {} pixels", pixels.len(), extent.area())));
    }
    reserved.shrink_to(size_of_val(&*pixels) as u64);
    reserved.keep();
    Ok(Image { extent, pixels })
}

fn fault(what: String) -> Fault {
    Fault::Invalid(format!("it cannot be decoded: {what}"))
}
