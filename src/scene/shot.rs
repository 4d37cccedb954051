//! Shots: scene, viewpoint and light, described by a TOML file.
//!
//! [`Draft::parse`] rejects invalid input: every value of a [`Draft`] is finite and within its range. `file` defines
//! the layout of the TOML; `check` turns it into a draft or an error with line and key. Once the scene is known,
//! [`complete`](super::complete) makes a [`Shot`] of the draft, which `write` turns into a file again.

pub mod allowed;
mod check;
mod file;
mod write;

use std::ops::RangeInclusive;

use glam::Vec3;
use serde_json::{Map, Value};

use super::motion::play::{Choice, Move, Play};
use super::rig::{Rig, RigKey};
use super::{Light, LightKind, SceneError};
use crate::image::tone::ToneCurve;

#[derive(Clone, Debug, PartialEq)]
pub enum SceneSource {
    /// A glTF file. The path is relative to the shot's folder.
    File(String),
    /// A built-in scene.
    Builtin(String),
}

#[derive(Clone, Debug, PartialEq)]
pub enum Sky {
    /// Linear RGB radiance.
    Constant(Vec3),
    /// A latitude-longitude `.hdr` or `.exr`. The path is relative to the shot's folder.
    Image(String),
    /// The built-in studio, with a ground for objects.
    Studio,
    /// The built-in sky.
    Clear,
}

impl Sky {
    /// Returns the built-in environment of this name, in shot files and on the command line.
    pub fn built_in(name: &str) -> Option<Self> {
        match name {
            "studio" => Some(Self::Studio),
            "sky" => Some(Self::Clear),
            _ => None,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct ShotEnvironment {
    pub sky: Sky,
    pub scale: f32,
    /// Rotation of an image; of a built-in environment, in addition to the direction of the first view.
    pub rotation_deg: f32,
}

impl From<Sky> for ShotEnvironment {
    fn from(sky: Sky) -> Self {
        Self { sky, scale: 1.0, rotation_deg: 0.0 }
    }
}

/// Kind of a light. Positions are in scene units, `direction` is a unit vector, and angles and cones are half-angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShotLightKind {
    Point { position: Vec3, radius_m: f64 },
    Directional { direction: Vec3, angle_deg: f64 },
    Spot { position: Vec3, radius_m: f64, direction: Vec3, inner_cone_deg: f64, outer_cone_deg: f64 },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotLight {
    pub kind: ShotLightKind,
    /// Colour × intensity: for point and spot lights W/sr, with distances in scene units; for directional lights W/m².
    pub strength: Vec3,
}

/// Gaze of an eye over time, as fractions of its image from the top left.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Gaze {
    /// Points (time in seconds, x, y); at least one, at strictly increasing times.
    pub path: Vec<[f64; 3]>,
}

impl Default for Gaze {
    fn default() -> Self {
        Self { path: vec![[0.0, 0.5, 0.5]] }
    }
}

impl Gaze {
    /// Returns (x, y) at `time_s`: linear between the path's points, clamped outside.
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

/// Valid exposures in stops. White paper is displayed as white at −15 in sunlight (100,000 lux) and at +12 in
/// starlight. Intermediate images store radiance times 2^exposure in half floats, and the square of that in f32, with the
/// exposure rounded to whole stops.
pub const EXPOSURE_EV: RangeInclusive<f64> = -24.0..=24.0;

/// Rig settings of a shot file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartialRig {
    pub yfov_rad: Option<f64>,
    pub views: Option<usize>,
    pub baseline_m: Option<f64>,
    pub convergence_m: Option<f64>,
    pub metres_per_unit: Option<f64>,
    /// Keys as in a [`Rig`]; may be empty.
    pub keys: Vec<RigKey>,
}

/// Contents of a shot file. A value of `None` comes from the scene or from a default.
#[derive(Clone, Debug, PartialEq)]
pub struct Draft {
    pub name: String,
    pub scene: SceneSource,
    pub animation: Option<Choice>,
    pub loops: Option<bool>,
    pub moves: Vec<Move>,
    pub rig: PartialRig,
    pub environment: Option<ShotEnvironment>,
    /// Lights in addition to the scene's own.
    pub lights: Vec<ShotLight>,
    pub gaze: Option<Gaze>,
    pub exposure: Option<Exposure>,
    /// Settings of the table `[render]`, unchecked.
    pub settings: Map<String, Value>,
}

/// Returns the settings of the table `[render]` of a shot's text. There are none if the text is invalid, which loading
/// the shot reports.
pub fn settings_of(text: &str) -> Map<String, Value> {
    Draft::parse(text, "").map(|draft| draft.settings).unwrap_or_default()
}

/// Exposure of pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// Metered before the run.
    Auto,
    /// Exposure in stops, within [`EXPOSURE_EV`].
    Ev(f32),
}

impl Draft {
    /// Reads the TOML `text`. `origin` is the file's name for messages; its stem is the default name of the shot.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] with the line, the key and the allowed values.
    pub fn parse(text: &str, origin: &str) -> Result<Draft, SceneError> {
        check::draft(text, origin)
    }

    /// Returns an otherwise empty draft for a scene that comes without a shot.
    pub fn of(scene: SceneSource, name: String) -> Draft {
        Draft {
            name,
            scene,
            animation: None,
            loops: None,
            moves: Vec::new(),
            rig: PartialRig::default(),
            environment: None,
            lights: Vec::new(),
            gaze: None,
            exposure: None,
            settings: Map::new(),
        }
    }

    /// Fills in missing values from `other`. Environment and lights come from `other` only if both are missing.
    pub fn or(self, other: Draft) -> Draft {
        let is_lit = self.environment.is_some() || !self.lights.is_empty();
        let (environment, lights) =
            if is_lit { (self.environment, self.lights) } else { (other.environment, other.lights) };
        Draft {
            animation: self.animation.or(other.animation),
            loops: self.loops.or(other.loops),
            rig: PartialRig {
                yfov_rad: self.rig.yfov_rad.or(other.rig.yfov_rad),
                views: self.rig.views.or(other.rig.views),
                baseline_m: self.rig.baseline_m.or(other.rig.baseline_m),
                convergence_m: self.rig.convergence_m.or(other.rig.convergence_m),
                metres_per_unit: self.rig.metres_per_unit.or(other.rig.metres_per_unit),
                keys: if self.rig.keys.is_empty() { other.rig.keys } else { self.rig.keys },
            },
            environment,
            lights,
            gaze: self.gaze.or(other.gaze),
            exposure: self.exposure.or(other.exposure),
            ..self
        }
    }

    /// Returns the animations and moves to play, with defaults for those left open.
    pub fn play(&self) -> Play {
        let default = Play::default();
        Play {
            animation: self.animation.clone().unwrap_or(default.animation),
            loops: self.loops.unwrap_or(default.loops),
            moves: self.moves.clone(),
        }
    }

    /// Returns true if the draft has neither rig keys nor lights nor an environment.
    pub fn is_bare(&self) -> bool {
        self.rig.keys.is_empty() && self.environment.is_none() && self.lights.is_empty()
    }
}

/// A shot with everything needed to render it.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    pub name: String,
    pub scene: SceneSource,
    pub play: Play,
    pub rig: Rig,
    /// Environment; `None` keeps the scene's.
    pub environment: Option<ShotEnvironment>,
    /// Lights in addition to the scene's own.
    pub lights: Vec<ShotLight>,
    pub gaze: Gaze,
    /// Exposure in stops, within [`EXPOSURE_EV`]. It does not scale linear images.
    pub exposure_ev: f32,
    /// True if a command that renders is to meter the exposure; `exposure_ev` is 0 until then.
    pub is_metered: bool,
    /// Tone curve of pictures.
    pub tone: ToneCurve,
    /// Settings of the table `[render]`, unchecked.
    pub settings: Map<String, Value>,
}

impl Shot {
    /// Returns the shot as a file that [`Draft::parse`] reads, with comments that explain the keys.
    pub fn text(&self) -> String {
        write::text(self)
    }

    /// Returns the shot's lights in scene units.
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
