//! What a ray runs in: the volume behind thick transmitting surfaces, which attenuates.

use diptych::scene::Volume;
use glam::DVec3;

use super::surface::Surface;

/// The volume around the viewer's ray, as far as it is known. Volumes do not nest: the last one entered counts, and
/// after leaving it there is none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Medium(Option<Volume>);

impl Medium {
    /// What a ray that met `surface` ran in: behind a thick surface its volume, if no other was known.
    pub fn known_at(self, surface: &Surface) -> Self {
        Self(self.0.or(surface.volume.filter(|_| surface.on_back)))
    }

    /// What a ray that leaves `surface` towards `direction` runs in.
    pub fn beyond(self, surface: &Surface, direction: DVec3) -> Self {
        match surface.volume {
            Some(volume) if surface.geometric_normal.dot(direction) < 0.0 => Self((!surface.on_back).then_some(volume)),
            _ => self,
        }
    }

    /// attenuation_color^(distance / attenuation_distance): the law of Beer and Lambert in glTF's terms.
    pub fn transmittance(self, distance: f64) -> DVec3 {
        match self.0 {
            Some(volume) if volume.attenuation_distance.is_finite() => {
                let lengths = distance / f64::from(volume.attenuation_distance);
                // 1 to the power of infinity is 1: nothing is lost.
                volume.attenuation_color.as_dvec3().powf(lengths)
            }
            _ => DVec3::ONE,
        }
    }
}
