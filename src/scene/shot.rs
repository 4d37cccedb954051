//! A shot: what is seen, from where, lit how, as a TOML file says it.
//!
//! [`Shot::parse`] accepts nothing half-right: every value of a [`Shot`] is finite and within its range.
//! `file` holds the layout of the TOML, `check` turns it into a shot or an error with line and key.

mod check;
mod file;

use std::ops::RangeInclusive;

use glam::Vec3;

use super::rig::Rig;
use super::{Light, LightKind, SceneError};

#[derive(Clone, Debug, PartialEq)]
pub enum SceneSource {
    /// A glTF file, as written in the shot: relative to the shot's own folder.
    File(String),
    /// A scene made by a generator of this crate.
    Builtin(String),
}

#[derive(Clone, Debug, PartialEq)]
pub enum Sky {
    /// Linear RGB radiance.
    Constant(Vec3),
    /// A latitude-longitude `.hdr` or `.exr`, relative to the shot's folder.
    Image(String),
}

#[derive(Clone, Debug, PartialEq)]
pub struct ShotEnvironment {
    pub sky: Sky,
    pub scale: f32,
    pub rotation_deg: f32,
}

/// Positions in scene units, `direction` unit length, angles and cones measured from their axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShotLightKind {
    Point { position: Vec3, radius_m: f64 },
    Directional { direction: Vec3, angle_deg: f64 },
    Spot { position: Vec3, radius_m: f64, direction: Vec3, inner_cone_deg: f64, outer_cone_deg: f64 },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotLight {
    pub kind: ShotLightKind,
    /// Colour × intensity: W/sr (position units) for point and spot, W/m² for directional.
    pub strength: Vec3,
}

/// Where an eye looks, as fractions of its image from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaze {
    /// Time in seconds, x, y; at least one, times strictly increase.
    pub path: Vec<[f64; 3]>,
}

impl Default for Gaze {
    fn default() -> Self {
        Self { path: vec![[0.0, 0.5, 0.5]] }
    }
}

impl Gaze {
    /// (x, y) at `time_s`: linear between the path's points, held outside.
    pub fn at(&self, time_s: f64) -> [f64; 2] {
        let next = self.path.partition_point(|point| point[0] <= time_s);
        match (next.checked_sub(1).map(|i| self.path[i]), self.path.get(next)) {
            (Some([t0, x0, y0]), Some([t1, x1, y1])) => {
                let s = (time_s - t0) / (t1 - t0);
                [x0 + (x1 - x0) * s, y0 + (y1 - y0) * s]
            }
            (Some([_, x, y]), None) | (None, Some(&[_, x, y])) => [x, y],
            (None, None) => [0.5, 0.5],
        }
    }
}

/// Stops that a picture may be exposed by. White paper in the sun, lit by 100,000 lux, is white at −15, under stars at +12.
/// Light on its way to the picture is kept in half floats scaled by 2 to this power, and its squares in f32.
pub const EXPOSURE_EV: RangeInclusive<f64> = -24.0..=24.0;

#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    pub name: String,
    pub scene: SceneSource,
    pub rig: Rig,
    /// `None`: the scene keeps its own.
    pub environment: Option<ShotEnvironment>,
    /// Beside the scene's own.
    pub lights: Vec<ShotLight>,
    pub gaze: Gaze,
    /// Stops, within [`EXPOSURE_EV`]. Linear images are not scaled by it.
    pub exposure_ev: f32,
}

impl Shot {
    /// Reads the TOML `text`; `origin` is the file's name for messages, and its stem the name of a shot that
    /// gives none.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] with the line, the key and what is allowed there.
    pub fn parse(text: &str, origin: &str) -> Result<Shot, SceneError> {
        check::shot(text, origin)
    }

    /// The shot's lights in scene units.
    pub fn lights(&self) -> Vec<Light> {
        let units = |metres: f64| (metres / self.rig.metres_per_unit) as f32;
        let light = |light: &ShotLight| Light { kind: light.kind.in_units(units), strength: light.strength };
        self.lights.iter().map(light).collect()
    }
}

impl ShotLightKind {
    fn in_units(self, units: impl Fn(f64) -> f32) -> LightKind {
        let cos = |deg: f64| deg.to_radians().cos() as f32;
        match self {
            Self::Point { position, radius_m } => LightKind::Point { position, radius: units(radius_m) },
            Self::Directional { direction, angle_deg } => {
                LightKind::Directional { direction, angle_rad: angle_deg.to_radians() as f32 }
            }
            Self::Spot { position, radius_m, direction, inner_cone_deg, outer_cone_deg } => LightKind::Spot {
                position,
                radius: units(radius_m),
                direction,
                cos_inner: cos(inner_cone_deg),
                cos_outer: cos(outer_cone_deg),
            },
        }
    }
}

#[cfg(test)]
mod tests;
