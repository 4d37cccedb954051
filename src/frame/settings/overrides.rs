//! Settings that replace those of a shot.

use super::Settings;
use crate::scene::complete::{Look, Overrides};

impl Settings {
    /// Returns what replaces the shot's own camera, light and animation.
    pub fn overrides(&self, look: Look, time_s: f64) -> Overrides {
        Overrides {
            yfov_rad: self.yfov.map(f64::to_radians),
            views: self.views.map(|views| views as usize),
            baseline_m: self.baseline,
            convergence_m: self.convergence,
            metres_per_unit: self.metres_per_unit,
            exposure: self.exposure,
            orbit: self.orbit,
            camera: self.camera.map(|camera| camera as usize),
            position: self.position,
            target: self.target,
            environment: self.environment.clone(),
            look,
            tone: self.tonemap,
            animation: self.animation.clone(),
            variant: self.variant.clone(),
            time_s,
        }
    }
}
