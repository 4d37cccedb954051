//! Reports the shared (rectified) projection from which both eyes' display images are resampled.

use std::fmt;

use serde::Serialize;

use diptych::image::Extent;

/// Shared projection of both eyes, present with display resampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RectifiedFrame {
    pub width: u32,
    pub height: u32,
    /// Number of pixels of the shared projection, divided by that of an eye's display image.
    pub pixels_ratio: f64,
}

impl RectifiedFrame {
    pub fn new(rendered: Extent, shown: Extent) -> Self {
        let pixels_ratio = rendered.area() as f64 / shown.area() as f64;
        Self { width: rendered.width, height: rendered.height, pixels_ratio }
    }
}

impl fmt::Display for RectifiedFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, pixels_ratio } = self;
        write!(
            f,
            "eyes are resampled from a frame that they share, {width}x{height}: {pixels_ratio:.2} times their pixels"
        )
    }
}
