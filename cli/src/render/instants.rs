//! Instants of frames on the camera path, and how long frames probably take.

use crate::options::RenderOptions;

/// Returns the time of a frame on the camera path, seconds.
pub fn time_s(options: &RenderOptions, frame: u32) -> f64 {
    options.settings.time + f64::from(frame) / options.fps
}

/// Returns true if the next frame probably takes long, and is rendered with progress; `last_ms` is the makespan of the
/// last frame. The first one may take any time.
pub fn takes_long(last_ms: Option<f64>) -> bool {
    last_ms.is_none_or(|ms| ms > 500.0)
}
