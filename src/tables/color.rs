//! Decoding of sRGB codes, and the luminance of linear colours.

use glam::Vec3;

use crate::image::display;

/// Decodes an 8-bit sRGB code (IEC 61966-2-1).
pub fn linear_from_srgb(code: u8) -> f32 {
    display::linear_from_srgb(f64::from(code) / 255.0) as f32
}

/// Returns the Rec. 709 luminance.
pub fn luminance(c: Vec3) -> f64 {
    display::luminance(c.to_array().map(f64::from))
}
