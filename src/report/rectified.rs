//! The frame that eyes are resampled from, where they show other images than are rendered.

use std::fmt;

use serde::Serialize;

use crate::image::Extent;

/// The frame that both eyes share where what they show is resampled from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RectifiedFrame {
    pub width: u32,
    pub height: u32,
    /// Its pixels over those that an eye shows.
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
