//! The medium of a ray: the attenuating volume behind thick transmitting surfaces.

use diptych::scene::Volume;
use glam::DVec3;

use super::surface::Surface;

/// Volume around the viewer's ray, as far as it is known. Volumes do not nest: the last one entered counts, and there
/// is none after leaving it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Medium(Option<Volume>);

impl Medium {
    /// Returns the medium of a ray that hit `surface`: behind a thick surface its volume, if no other was known.
    pub fn known_at(self, surface: &Surface) -> Self {
        Self(self.0.or(surface.volume.filter(|_| surface.on_back)))
    }

    /// Returns the medium of a ray that leaves `surface` in `direction`.
    pub fn beyond(self, surface: &Surface, direction: DVec3) -> Self {
        match surface.volume {
            Some(volume) if surface.geometric_normal.dot(direction) < 0.0 => Self((!surface.on_back).then_some(volume)),
            _ => self,
        }
    }

    /// Returns attenuation_color^(distance / attenuation_distance): the Beer–Lambert law in glTF's terms.
    pub fn transmittance(self, distance: f64) -> DVec3 {
        match self.0 {
            Some(volume) if volume.attenuation_distance.is_finite() => {
                let lengths = distance / f64::from(volume.attenuation_distance);
                // 1 to the power of infinity is 1: light is not attenuated.
                volume.attenuation_color.as_dvec3().powf(lengths)
            }
            _ => DVec3::ONE,
        }
    }
}
