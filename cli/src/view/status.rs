//! Session data that the window and the panel show in addition to frame times.

use diptych::image::Extent;

/// Session data that is known before the first frame.
pub struct ViewStatus {
    pub scene: String,
    pub eye: Extent,
    pub band_ms: [f64; 2],
    pub devices: Vec<String>,
    pub is_foveated: bool,
}
