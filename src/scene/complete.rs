//! Completes the draft of a shot file to a [`Shot`], with values from overrides and from the scene.
//!
//! A shot without a viewpoint uses the scene's first camera, or else a viewpoint that a search finds. If such a shot
//! has no light either, and its scene has none, it gets a white environment or a studio.

use glam::{DVec3, Vec3};

use super::budget::Budget;
use super::motion::Motion;
use super::motion::play::Choice;
use super::rig::{DEFAULT_BASELINE_M, Rig, RigKey, degenerate_time};
use super::shot::allowed::fits_f32;
use super::shot::{Draft, Exposure, PartialRig, Shot, ShotEnvironment, ShotLight, ShotLightKind, Sky};
use super::viewpoint::{self, Orbit, Room, Viewpoint, Wanted};
use super::{Camera, Environment, Scene, SceneError, Setting};
use crate::image::tone::ToneCurve;

/// Look of a scene file without a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    /// The look of a shot that leaves everything open: a white environment if the file has no light.
    #[default]
    Plain,
    /// A studio if the file has no light, a metered exposure, and the tone curve PBR Neutral.
    Studio,
}

/// Settings that take precedence over those of a shot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overrides {
    pub yfov_rad: Option<f64>,
    pub views: Option<usize>,
    pub baseline_m: Option<f64>,
    pub convergence_m: Option<f64>,
    pub metres_per_unit: Option<f64>,
    pub exposure: Option<Exposure>,
    /// Index of a camera in the scene file.
    pub camera: Option<usize>,
    /// Fixed position of the eyes, scene units.
    pub position: Option<DVec3>,
    /// Fixed point that the eyes look at, scene units.
    pub target: Option<DVec3>,
    /// View of the whole scene from outside, instead of the cameras of the scene and the shot.
    pub orbit: Option<Orbit>,
    /// Environment that replaces the shot's. The path of its image is relative to the working folder.
    pub environment: Option<ShotEnvironment>,
    /// Look of a scene file without a shot.
    pub look: Look,
    /// Tone curve of pictures.
    pub tone: Option<ToneCurve>,
    /// Animations of the scene file to play.
    pub animation: Option<Choice>,
    /// Material variant of the scene file, by its name; `None` for the default look.
    pub variant: Option<String>,
    /// Time in seconds at which the scene's cameras are sampled.
    pub time_s: f64,
}

/// Completes a draft. `scene` must be in its state at `overrides.time_s`; `motion` animates its cameras. Appends a
/// warning to the scene if this function had to choose a camera or a viewpoint.
///
/// # Errors
/// [`SceneError::Setting`], if the overrides do not fit the scene or define no view direction.
pub fn complete(
    draft: Draft,
    overrides: &Overrides,
    scene: &mut Scene,
    motion: &Motion,
    budget: &Budget,
) -> Result<Shot, SceneError> {
    let is_unlit = draft.is_bare() && !has_light(scene);
    let (light, tone, exposure) = match overrides.look {
        Look::Plain => (Sky::Constant(Vec3::ONE), ToneCurve::Reinhard, Exposure::Ev(0.0)),
        Look::Studio => (Sky::Studio, ToneCurve::Neutral, Exposure::Auto),
    };
    let lights_rooms = is_unlit && overrides.look == Look::Studio && overrides.environment.is_none();
    let (rig, room) = rig(&draft.rig, lights_rooms, overrides, scene, motion, budget)?;
    let fill = room.filter(|room| lights_rooms && room.openness < LEAST_OPENNESS).map(|room| fill_light(&rig, room));
    if fill.is_some() {
        scene.notes.push("the room has hardly any openings: added a light at the camera".to_owned());
    }
    let exposure = overrides.exposure.or(draft.exposure).unwrap_or(exposure);
    Ok(Shot {
        play: draft.play(),
        name: draft.name,
        scene: draft.scene,
        rig,
        environment: overrides.environment.clone().or(draft.environment).or_else(|| is_unlit.then(|| light.into())),
        lights: draft.lights.into_iter().chain(fill).collect(),
        gaze: draft.gaze.unwrap_or_default(),
        exposure_ev: if let Exposure::Ev(ev) = exposure { ev } else { 0.0 },
        is_metered: exposure == Exposure::Auto,
        tone: overrides.tone.unwrap_or(tone),
        settings: draft.settings,
    })
}

/// Returns true if the scene has lights or an environment. Emissive surfaces do not count, since most are displays and
/// small lamps that do not light a scene.
fn has_light(scene: &Scene) -> bool {
    !scene.lights.is_empty() || scene.environment != Environment::Black
}

/// Fraction of directions in which a room must be open to be lit from outside.
const LEAST_OPENNESS: f32 = 0.1;

/// Returns a light above the camera and below the ceiling that lights a room.
fn fill_light(rig: &Rig, room: Room) -> ShotLight {
    let above = DVec3::Y * f64::from((0.1 * room.distance).min(0.5 * room.headroom));
    let kind = ShotLightKind::Point { position: (rig.keys[0].position + above).as_vec3(), radius_m: 0.0 };
    ShotLight { kind, strength: Vec3::splat(room.distance * room.distance) }
}

/// Returns the rig, and its surroundings if `lights_rooms` is true: then a closed room gets light.
fn rig(
    draft: &PartialRig,
    lights_rooms: bool,
    overrides: &Overrides,
    scene: &mut Scene,
    motion: &Motion,
    budget: &Budget,
) -> Result<(Rig, Option<Room>), SceneError> {
    let metres_per_unit = overrides.metres_per_unit.or(draft.metres_per_unit).unwrap_or(1.0);
    let yfov_rad = overrides.yfov_rad.or(draft.yfov_rad);
    let of_keys = |keys| Rig { metres_per_unit, ..Rig::of_keys(keys) };
    let camera = overrides.camera.or((draft.keys.is_empty() && !scene.cameras.is_empty()).then_some(0));
    let wanted = Wanted { metres_per_unit, yfov_rad, orbit: overrides.orbit, lights_rooms };
    let (mut rig, mut room) = match (camera, overrides.position.zip(overrides.target)) {
        _ if overrides.orbit.is_some() => (viewpoint::find(scene, &wanted, budget).rig, None),
        (Some(number), _) => (camera_rig(scene, motion, number, overrides)?, None),
        (None, _) if !draft.keys.is_empty() => (of_keys(draft.keys.clone()), None),
        (None, Some((position, target))) => {
            (of_keys(vec![RigKey { time_s: 0.0, position, target, up: DVec3::Y }]), None)
        }
        (None, None) => found_rig(scene, &wanted, overrides.baseline_m.or(draft.baseline_m), budget),
    };
    if overrides.position.is_some() {
        room = None;
    }
    rig.metres_per_unit = metres_per_unit;
    rig.yfov_rad = yfov_rad.unwrap_or(rig.yfov_rad);
    rig.baseline_m = overrides.baseline_m.or(draft.baseline_m).unwrap_or(rig.baseline_m);
    rig.views = overrides.views.or(draft.views).unwrap_or(rig.views);
    rig.convergence_m = overrides.convergence_m.or(draft.convergence_m);
    if !fits_f32(rig.baseline_m / metres_per_unit) {
        let what = "it is too large a number in the scene's units".to_owned();
        return Err(SceneError::Setting { setting: Setting::Baseline, what });
    }
    move_to(&mut rig.keys, overrides)?;
    if lights_rooms && room.is_none() {
        room = viewpoint::room_around(scene, rig.keys[0].position, budget);
    }
    Ok((rig, room))
}

/// Returns the rig of the scene file's camera `number`: for a moving camera, a path that begins at the overrides' time.
fn camera_rig(scene: &mut Scene, motion: &Motion, number: usize, overrides: &Overrides) -> Result<Rig, SceneError> {
    let count = scene.cameras.len();
    let Some(&camera) = scene.cameras.get(number) else {
        let what = match count {
            0 => "the scene's file has no camera".to_owned(),
            _ => format!("the scene's file has cameras 0 to {}", count - 1),
        };
        return Err(SceneError::Setting { setting: Setting::Camera(number), what });
    };
    if count > 1 && overrides.camera.is_none() {
        let last = count - 1;
        scene.notes.push(format!(
            "taking the first of {count} cameras in the file; another can be chosen by its number, 0 to {last}"
        ));
    }
    let is_moving = motion.cameras.iter().any(|c| c.index == number) && motion.duration_s() > 0.0;
    let keys = if is_moving { camera_path(camera, motion, number, overrides.time_s) } else { Vec::new() };
    let rig = Rig::from_camera(camera);
    Ok(if keys.is_empty() { rig } else { Rig { keys, ..rig } })
}

/// Number of keys per second of a camera's path, and minimum duration of the path in seconds if animations loop.
const PATH_HZ: f64 = 60.0;
const LOOPS_S: f64 = 60.0;

/// Returns a camera's path from `time_s` to the end of the animations. If they loop, the path lasts one loop or
/// [`LOOPS_S`], whichever is longer.
fn camera_path(camera: Camera, motion: &Motion, number: usize, time_s: f64) -> Vec<RigKey> {
    let end_s = if motion.loops { time_s + motion.duration_s().max(LOOPS_S) } else { motion.duration_s() };
    let cameras = motion.cameras.iter().copied().filter(|c| c.index == number);
    let moved = Motion { bodies: Vec::new(), cameras: cameras.collect(), ..motion.clone() };
    let mut place = Scene { cameras: vec![camera; number + 1], ..Scene::empty("") };
    let steps = ((end_s - time_s) * PATH_HZ).ceil().clamp(0.0, MOST_KEYS) as u32;
    let keys = (0..=steps).flat_map(|step| {
        let at_s = time_s + f64::from(step) / PATH_HZ;
        moved.place(&moved.pose(at_s), &mut place);
        Rig::from_camera(place.cameras[number]).keys.into_iter().map(move |key| RigKey { time_s: at_s, ..key })
    });
    keys.collect()
}

/// Maximum number of keys of a camera's path, which is enough for one hour.
const MOST_KEYS: f64 = 3600.0 * PATH_HZ;

/// Baseline in metres below which a scene is probably not in metres: that of an object of about a centimetre.
const TINY_BASELINE_M: f64 = 1e-3;

/// Returns the viewpoint that [`viewpoint::find`] chooses, and notes that the file has no camera. `baseline_m` is the
/// requested baseline.
fn found_rig(scene: &mut Scene, wanted: &Wanted, baseline_m: Option<f64>, budget: &Budget) -> (Rig, Option<Room>) {
    let Viewpoint { rig, room } = viewpoint::find(scene, wanted, budget);
    let RigKey { position, target, .. } = rig.keys[0];
    let place = if room.is_some() { "inside the scene" } else { "in front of the scene" };
    let baseline = match baseline_m {
        None if rig.baseline_m < DEFAULT_BASELINE_M => {
            let unit = if rig.baseline_m < TINY_BASELINE_M { ", unless its unit is not the metre" } else { "" };
            format!(", with a baseline of {:.3} mm that suits the scene's size{unit}", rig.baseline_m * 1e3)
        }
        _ => String::new(),
    };
    scene.notes.push(format!(
        "no camera in the file: placed the viewpoint {place} at {position:.3}, looking at {target:.3}{baseline}; set \
         `position` and `target`, or write a shot, to change it"
    ));
    (rig, room)
}

/// Overrides the position and the target of each key. If a key then looks along its up vector, −z becomes its up
/// vector.
fn move_to(keys: &mut [RigKey], overrides: &Overrides) -> Result<(), SceneError> {
    if overrides.position.is_none() && overrides.target.is_none() {
        return Ok(());
    }
    for key in &mut *keys {
        key.position = overrides.position.unwrap_or(key.position);
        key.target = overrides.target.unwrap_or(key.target);
        if key.is_degenerate() {
            key.up = DVec3::NEG_Z;
        }
    }
    let Some(time_s) = degenerate_time(keys) else { return Ok(()) };
    let what = format!(
        "at {time_s} s position and target are the same point, or the eyes look along their up vector: give others"
    );
    Err(SceneError::Setting { setting: Setting::View, what })
}

#[cfg(test)]
mod tests;
