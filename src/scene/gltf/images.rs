//! Decodes PNG, JPEG and WebP images to 8-bit RGBA texels, without conversion of colour.

use std::io::Cursor;

use ::image::{ImageFormat, ImageReader, Limits};

use super::fault::{Fault, Outcome};
use crate::image::{Extent, Image};
use crate::scene::TexelImage;

/// Longest side, pixels.
const MAX_SIDE: u32 = 16384;

/// What decoding one image may take, bytes.
const MAX_DECODING: u64 = 2 << 30;

pub fn decode(bytes: &[u8]) -> Outcome<TexelImage> {
    let fault = |what: String| Fault::Invalid(format!("it does not decode: {what}"));
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| fault(e.to_string()))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) {
        return Err(fault(format!("its {} bytes are no PNG, JPEG or WebP", bytes.len())));
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_DECODING);
    reader.limits(limits);
    let rgba = reader.decode().map_err(|e| fault(e.to_string()))?.into_rgba8();
    let extent = Extent::new(rgba.width(), rgba.height());
    let pixels = rgba.as_raw().as_chunks::<4>().0.to_vec();
    Ok(Image { extent, pixels })
}
