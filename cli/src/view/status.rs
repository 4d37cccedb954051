//! Session data that the window and the panel show in addition to frame times.

use crate::play::Prepared;
use diptych::device::DeviceInfo;
use diptych::image::Extent;
use diptych::loaded::LoadedScene;

/// Session data that is known before the first frame.
pub struct ViewStatus {
    pub scene: String,
    pub eye: Extent,
    pub band_ms: [f64; 2],
    pub devices: Vec<String>,
    pub is_foveated: bool,
}

impl ViewStatus {
    pub fn new(prepared: &Prepared, loaded: &LoadedScene, devices: &[DeviceInfo]) -> Self {
        let Prepared { options, render, .. } = prepared;
        Self {
            scene: loaded.shot.name.clone(),
            eye: render.settings.size,
            band_ms: [options.budget_ms.lo_ms(), options.budget_ms.hi_ms()],
            devices: devices.iter().map(|info| format!("dev{} {}", info.index, info.name)).collect(),
            is_foveated: render.quality().fovea.is_some(),
        }
    }
}
