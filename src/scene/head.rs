//! Head motion: poses of a viewer's head over time, which a run reads from a file or records to one.
//!
//! A file has one JSON value per line. The first is `{"diptych_motion": 1}`, the version, which may include the head's
//! [`eyes`](HeadEyes). Samples follow in the order of their times, such as `{"time_s": 0.5, "position_m": [0, 0, 0],
//! "orientation": [0, 0, 0, 1]}`. Axes are those of OpenXR: x to the right, y up, −z ahead. Orientations are unit
//! quaternions (x, y, z, w) from the head's axes to those of the [`Space`].

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::SceneError;
use super::budget::Budget;
use super::error::Fault;
use super::folder::{self, Access};
use super::optics::{HeadEyes, Rectified};
use super::rig::{Rig, RigKey, Turning};
use super::shot::Gaze;
use super::shot::allowed::fits_f32;
use crate::image::ImageError;
use crate::image::file::{LineFile, keep_unfinished};

/// Version of written files, and the only one that is read.
const VERSION: u32 = 1;
/// Maximum number of samples in a file: hours of head motion at the frame rate of a headset.
const MOST_SAMPLES: usize = 1_000_000;
/// Tolerance on the length of an orientation, since files hold few digits.
const LENGTH_SLACK: f64 = 1e-2;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    diptych_motion: u32,
    /// Description for readers of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    about: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    eyes: Option<HeadEyes>,
}

/// Sample of a head motion, stored as one line of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sample {
    time_s: f64,
    position_m: [f64; 3],
    orientation: [f64; 4],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gaze: Option<EyesGaze>,
}

/// Gaze points (x, y) of the left and the right eye, as fractions of each eye's image from the top left. Files hold
/// either two numbers that apply to both eyes, or four.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<f64>", into = "Vec<f64>")]
struct EyesGaze([[f64; 2]; 2]);

impl TryFrom<Vec<f64>> for EyesGaze {
    type Error = &'static str;

    fn try_from(numbers: Vec<f64>) -> Result<Self, Self::Error> {
        let eyes = match numbers[..] {
            [x, y] => Some([[x, y]; 2]),
            [left_x, left_y, right_x, right_y] => Some([[left_x, left_y], [right_x, right_y]]),
            _ => None,
        };
        let are_within = numbers.iter().all(|v| (0.0..=1.0).contains(v));
        eyes.filter(|_| are_within).map(Self).ok_or("gaze must be two or four numbers from 0 to 1")
    }
}

impl From<EyesGaze> for Vec<f64> {
    fn from(EyesGaze([left, right]): EyesGaze) -> Self {
        if left == right { left.to_vec() } else { [left, right].concat() }
    }
}

impl Sample {
    /// Returns a description of the first fault, if any. `last_s` is the time of the previous sample.
    fn fault(&self, last_s: Option<f64>) -> Option<String> {
        let Self { time_s, position_m, orientation, .. } = self;
        let length = DQuat::from_array(*orientation).length();
        let is_finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        if !is_finite(&[*time_s]) || !is_finite(position_m) || !is_finite(orientation) {
            return Some("its numbers must be finite".to_owned());
        }
        if (length - 1.0).abs() > LENGTH_SLACK {
            return Some(format!("orientation {orientation:?} has the length {length:.3} and must have 1"));
        }
        let last_s = last_s.filter(|last_s| time_s <= last_s)?;
        Some(format!("time_s {time_s} is not after the {last_s} of the previous sample"))
    }
}

/// Pose of a head relative to a [`Space`]: its position in metres, and its rotation to the axes of the space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeadPose {
    pub position_m: DVec3,
    /// Rotation as a unit quaternion.
    pub orientation: DQuat,
}

impl HeadPose {
    /// Transforms `own`, a pose relative to this head, to the head's space.
    pub fn then(self, own: Self) -> Self {
        Self {
            position_m: self.position_m + self.orientation * own.position_m,
            orientation: (self.orientation * own.orientation).normalize(),
        }
    }
}

/// Reference space of a head's poses in metres, and the head's eyes. At the identity pose the head is upright, at the
/// first position of the shot's rig, with the shot's heading but a level gaze.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space {
    /// Origin in scene units.
    origin: DVec3,
    world_from_space: DQuat,
    metres_per_unit: f64,
    /// Eyes of the head; `None` keeps the shot's eyes.
    eyes: Option<(HeadEyes, Rectified)>,
}

impl Space {
    /// Returns the space that a shot's rig defines. The space keeps the shot's eyes.
    pub fn of(rig: &Rig) -> Self {
        let first = &rig.keys[0];
        let (up, [right, ..]) = (first.up.normalize(), first.axes());
        let axes = DMat3::from_cols(right, up, right.cross(up));
        let world_from_space = DQuat::from_mat3(&axes).normalize();
        Self { origin: first.position, world_from_space, metres_per_unit: rig.metres_per_unit, eyes: None }
    }

    /// Replaces the eyes. If the space had eyes before, the field of view of the shared frame does not change.
    ///
    /// # Errors
    /// A message, if `eyes` is not a valid pair of eyes.
    pub fn with_eyes(self, eyes: HeadEyes) -> Result<Self, String> {
        let mut shared = eyes.rectified()?;
        if let Some((_, before)) = self.eyes {
            shared.optics.tan_half = before.optics.tan_half;
        }
        Ok(Self { eyes: Some((eyes, shared)), ..self })
    }

    /// Returns a static rig at this pose of the head. `shot` provides all settings that the pose and the
    /// eyes of the space do not determine.
    pub fn rig_at(&self, HeadPose { position_m, orientation }: HeadPose, shot: &Rig) -> Rig {
        let sample = Sample { time_s: 0.0, position_m: position_m.into(), orientation: orientation.into(), gaze: None };
        self.rig_of(vec![self.key(&sample)], shot)
    }

    /// Returns the rig's position in the head, in metres, and its rotation to the head's axes.
    fn head_from_rig(&self) -> (DVec3, DQuat) {
        let eyes = self.eyes.as_ref();
        eyes.map_or((DVec3::ZERO, DQuat::IDENTITY), |(_, shared)| (shared.position_m, shared.orientation))
    }

    /// Returns a copy of the rig `shot` with these keys. If the head has eyes of its own, their optics and baseline
    /// replace those of `shot`.
    fn rig_of(&self, keys: Vec<RigKey>, shot: &Rig) -> Rig {
        let rig = Rig { keys, turning: Turning::Spherical, ..shot.clone() };
        match &self.eyes {
            None => rig,
            Some((_, Rectified { optics, baseline_m, .. })) => {
                let yfov_rad = 2.0 * optics.tan_half[1].atan();
                Rig { yfov_rad, baseline_m: *baseline_m, optics: Some(*optics), ..rig }
            }
        }
    }

    fn key(&self, sample: &Sample) -> RigKey {
        let (between_m, turned) = self.head_from_rig();
        let head = DQuat::from_array(sample.orientation).normalize();
        let position_m = DVec3::from(sample.position_m) + head * between_m;
        let position = self.origin + self.world_from_space * (position_m / self.metres_per_unit);
        RigKey::turned(sample.time_s, position, self.world_from_space * head * turned)
    }

    fn sample(&self, time_s: f64, key: &RigKey, gaze: Option<[[f64; 2]; 2]>) -> Sample {
        let (between_m, turned) = self.head_from_rig();
        let space_from_world = self.world_from_space.conjugate();
        let orientation = (space_from_world * key.orientation() * turned.conjugate()).normalize();
        let position_m =
            space_from_world * (key.position - self.origin) * self.metres_per_unit - orientation * between_m;
        Sample { time_s, position_m: position_m.into(), orientation: orientation.into(), gaze: gaze.map(EyesGaze) }
    }
}

/// A validated head motion.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadMotion {
    /// Samples, at least one, in increasing order of time.
    samples: Vec<Sample>,
    eyes: Option<HeadEyes>,
}

impl HeadMotion {
    /// Reads a file.
    ///
    /// # Errors
    /// [`SceneError`] with the line, if the file cannot be read, exceeds the budget or is no head motion.
    pub fn read(path: &Path, budget: &Budget) -> Result<Self, SceneError> {
        let read = || Self::parse(&folder::read(path, Access::of(budget))?).map_err(Fault::Invalid);
        read().map_err(|fault| fault.in_file(path))
    }

    /// Parses a header line and one sample per line.
    ///
    /// # Errors
    /// A message with the number of the first invalid line.
    pub fn parse(text: &[u8]) -> Result<Self, String> {
        let lines = text.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
        let mut lines = (1..).zip(lines).filter(|(_, line)| !line.is_empty());
        let (number, line) = lines.next().ok_or("it is empty: its first line must be {\"diptych_motion\": 1}")?;
        let Header { diptych_motion: version, eyes, .. } = from_line(number, line)?;
        if version != VERSION {
            return Err(format!("line {number}: it is of version {version}, and this program reads {VERSION}"));
        }
        let mut samples: Vec<Sample> = Vec::new();
        for (number, line) in lines {
            if samples.len() == MOST_SAMPLES {
                return Err(format!("line {number}: it has more than {MOST_SAMPLES} samples"));
            }
            let sample: Sample = from_line(number, line)?;
            if let Some(fault) = sample.fault(samples.last().map(|last| last.time_s)) {
                return Err(format!("line {number}: {fault}"));
            }
            samples.push(sample);
        }
        if samples.is_empty() { Err("it has no sample".to_owned()) } else { Ok(Self { samples, eyes }) }
    }

    /// Returns the space of a shot, with the eyes of the file if it has any.
    ///
    /// # Errors
    /// A message, if the file's eyes are not a valid pair.
    pub fn space(&self, shot: &Rig) -> Result<Space, String> {
        let space = Space::of(shot);
        self.eyes.map_or(Ok(space), |eyes| space.with_eyes(eyes))
    }

    /// Returns a shot's rig that follows the head in the shot's space, with spherical interpolation of rotations. If
    /// the file has eyes, the rig is that of their shared frame.
    ///
    /// # Errors
    /// Errors of [`Self::space`], and a message, if a position is too far from the scene to be stored in f32 or to have
    /// a view direction.
    pub fn rig(&self, shot: &Rig) -> Result<Rig, String> {
        let space = self.space(shot)?;
        let keys: Vec<RigKey> = self.samples.iter().map(|sample| space.key(sample)).collect();
        let is_far = |key: &&RigKey| key.is_degenerate() || !key.position.to_array().into_iter().all(fits_f32);
        match keys.iter().find(is_far) {
            Some(key) => Err(format!("position_m at {} s is too far from the scene", key.time_s)),
            None => Ok(space.rig_of(keys, shot)),
        }
    }

    /// Returns the gaze paths of the left and the right eye, or `None` if no sample has a gaze.
    pub fn gaze(&self) -> Option<[Gaze; 2]> {
        let told = || self.samples.iter().filter_map(|s| Some((s.time_s, s.gaze?.0)));
        let path = |eye: usize| told().map(|(time_s, eyes)| [time_s, eyes[eye][0], eyes[eye][1]]).collect();
        told().next().is_some().then(|| [0, 1].map(|eye| Gaze { path: path(eye) }))
    }
}

/// Parses a line as JSON.
fn from_line<'a, T: Deserialize<'a>>(number: usize, line: &'a [u8]) -> Result<T, String> {
    let place = |error: serde_json::Error| {
        // The error may quote control characters from the line.
        error.to_string().replace(" at line 1 column ", ", column ").replace(char::is_control, " ")
    };
    serde_json::from_slice(line).map_err(|error| format!("line {number}: {}", place(error)))
}

/// Recorder of head motion. It writes to `NAME.part` until [`Self::finish`] gives the file its final name.
pub struct Recording {
    space: Space,
    path: PathBuf,
    file: LineFile,
    samples: usize,
    last_s: Option<f64>,
}

impl Recording {
    /// Creates a file that [`HeadMotion::read`] can read, with poses relative to `space`. If an earlier run left an
    /// unfinished file, renames it and also returns its new path.
    ///
    /// # Errors
    /// [`ImageError::Write`].
    pub fn create(space: Space, path: &Path) -> Result<(Self, Option<PathBuf>), ImageError> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let part = PathBuf::from(part);
        let kept = part.is_file().then(|| keep_unfinished(&part, path)).transpose()?;
        let mut recording =
            Self { space, path: path.to_owned(), file: LineFile::create(&part)?, samples: 0, last_s: None };
        let eyes = space.eyes.map(|(eyes, _)| eyes);
        recording.line(&Header { diptych_motion: VERSION, about: None, eyes })?;
        Ok((recording, kept))
    }

    /// Appends the rig's pose at `at_s` as the sample of `time_s`. Skips samples that are not later than the previous
    /// one or that exceed the limit of a file.
    ///
    /// # Errors
    /// [`ImageError::Write`].
    pub fn add(&mut self, time_s: f64, rig: &Rig, at_s: f64, gaze: Option<[[f64; 2]; 2]>) -> Result<(), ImageError> {
        if self.samples < MOST_SAMPLES && self.last_s.is_none_or(|last_s| last_s < time_s) {
            (self.samples, self.last_s) = (self.samples + 1, Some(time_s));
            self.line(&self.space.sample(time_s, &rig.key_at(at_s), gaze))?;
        }
        Ok(())
    }

    /// Renames the file to its final name.
    ///
    /// # Errors
    /// [`ImageError::Write`].
    pub fn finish(self) -> Result<(), ImageError> {
        self.file.rename(&self.path)
    }

    fn line(&mut self, value: &impl Serialize) -> Result<(), ImageError> {
        let failed = |error: serde_json::Error| ImageError::Write { path: self.path.clone(), source: error.into() };
        let mut line = serde_json::to_vec(value).map_err(failed)?;
        line.push(b'\n');
        self.file.add(&line)
    }
}

#[cfg(test)]
mod tests;
