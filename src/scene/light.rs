//! Lights that are not meshes.

use glam::Vec3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Point or sphere light of the given radius.
    Point { position: Vec3, radius: f32 },
    /// Light along the unit vector `direction`, in which it travels; `angle_rad` is the half-angle of the sun's disc.
    Directional { direction: Vec3, angle_rad: f32 },
    /// A point light limited to a cone around `direction`, with glTF's falloff between the two cosines.
    Spot { position: Vec3, radius: f32, direction: Vec3, cos_inner: f32, cos_outer: f32 },
}

/// A light that is not a mesh, in world space and scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    pub kind: LightKind,
    /// Colour × intensity, linear: W/sr for point and spot, W/m² for directional. A sphere (radius > 0) emits the
    /// radiance `strength / (π radius²)` and is visible to the camera and to bounced rays.
    pub strength: Vec3,
}

impl Light {
    /// Returns the radius of a point or spot light; `None` for a directional light.
    pub fn radius(&self) -> Option<f32> {
        match self.kind {
            LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } => Some(radius),
            LightKind::Directional { .. } => None,
        }
    }

    pub fn is_sun(&self) -> bool {
        self.radius().is_none()
    }

    /// Returns true if only light sampling finds the light, because no ray can hit it: a point or spot light without a
    /// radius, or a sun, whose disc is not part of the sky.
    pub fn is_delta(&self) -> bool {
        self.radius().is_none_or(|radius| radius <= 0.0)
    }

    /// Returns true if shadows of the light have hardly any penumbra: of a point or spot light without a radius, or of
    /// a sun with an angular radius of at most 1 degree.
    pub fn has_hard_shadows(&self) -> bool {
        match self.kind {
            LightKind::Directional { angle_rad, .. } => angle_rad <= HARD_ANGLE_RAD,
            _ => self.is_delta(),
        }
    }
}

/// Largest angular radius of a sun whose shadows count as hard. The Sun's is 0.0047.
const HARD_ANGLE_RAD: f32 = 0.0175;

/// Returns true if all directional lights have hard shadows.
pub fn are_suns_hard(lights: &[Light]) -> bool {
    lights.iter().filter(|light| light.is_sun()).all(Light::has_hard_shadows)
}
