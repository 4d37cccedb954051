//! What the window and the panel show beside frames.

use crate::image::Extent;

/// What the window is told before the first frame.
pub struct Look {
    pub scene: String,
    pub eye: Extent,
    pub band_ms: [f64; 2],
    pub devices: Vec<String>,
    pub is_foveated: bool,
}
