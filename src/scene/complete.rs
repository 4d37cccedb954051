//! Completes the draft of a shot file to a [`Shot`], with values from overrides and from the scene.
//!
//! A shot without a viewpoint uses the scene's first camera, or else a viewpoint that a search finds. If such a shot
//! has no light either, and its scene has none, it gets a white environment.

use glam::{DVec3, Vec3};

use super::budget::Budget;
use super::motion::Motion;
use super::motion::play::Choice;
use super::rig::{Rig, RigKey, degenerate_time};
use super::shot::allowed::fits_f32;
use super::shot::{Draft, PartialRig, Shot, ShotEnvironment, Sky};
use super::viewpoint::{self, Viewpoint};
use super::{Camera, Environment, Scene, SceneError, Setting};

/// Settings that take precedence over those of a shot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overrides {
    pub yfov_rad: Option<f64>,
    pub baseline_m: Option<f64>,
    /// Exposure in stops, within [`EXPOSURE_EV`](super::shot::EXPOSURE_EV).
    pub exposure_ev: Option<f32>,
    /// Index of a camera in the scene file.
    pub camera: Option<usize>,
    /// Fixed position of the eyes, scene units.
    pub position: Option<DVec3>,
    /// Fixed point that the eyes look at, scene units.
    pub target: Option<DVec3>,
    /// Environment that replaces the shot's. The path of its image is relative to the working folder.
    pub environment: Option<ShotEnvironment>,
    /// Animations of the scene file to play.
    pub animation: Option<Choice>,
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
    let white = ShotEnvironment { sky: Sky::Constant(Vec3::ONE), scale: 1.0, rotation_deg: 0.0 };
    let rig = rig(&draft.rig, overrides, scene, motion, budget)?;
    Ok(Shot {
        play: draft.play(),
        name: draft.name,
        scene: draft.scene,
        rig,
        environment: overrides.environment.clone().or(draft.environment).or(is_unlit.then_some(white)),
        lights: draft.lights,
        gaze: draft.gaze.unwrap_or_default(),
        exposure_ev: overrides.exposure_ev.or(draft.exposure_ev).unwrap_or(0.0),
    })
}

/// Returns true if the scene has lights or an environment. Emissive surfaces do not count, since most are displays and
/// small lamps that do not light a scene.
fn has_light(scene: &Scene) -> bool {
    !scene.lights.is_empty() || scene.environment != Environment::Black
}

fn rig(
    draft: &PartialRig,
    overrides: &Overrides,
    scene: &mut Scene,
    motion: &Motion,
    budget: &Budget,
) -> Result<Rig, SceneError> {
    let metres_per_unit = draft.metres_per_unit.unwrap_or(1.0);
    let yfov_rad = overrides.yfov_rad.or(draft.yfov_rad);
    let of_keys = |keys| Rig { metres_per_unit, ..Rig::of_keys(keys) };
    let camera = overrides.camera.or((draft.keys.is_empty() && !scene.cameras.is_empty()).then_some(0));
    let mut rig = match (camera, overrides.position.zip(overrides.target)) {
        (Some(number), _) => camera_rig(scene, motion, number, overrides)?,
        (None, _) if !draft.keys.is_empty() => of_keys(draft.keys.clone()),
        (None, Some((position, target))) => of_keys(vec![RigKey { time_s: 0.0, position, target, up: DVec3::Y }]),
        (None, None) => found_rig(scene, metres_per_unit, yfov_rad, budget),
    };
    rig.metres_per_unit = metres_per_unit;
    rig.yfov_rad = yfov_rad.unwrap_or(rig.yfov_rad);
    rig.baseline_m = overrides.baseline_m.or(draft.baseline_m).unwrap_or(rig.baseline_m);
    if !fits_f32(rig.baseline_m / metres_per_unit) {
        let what = "it is too large a number in the scene's units".to_owned();
        return Err(SceneError::Setting { setting: Setting::Baseline, what });
    }
    move_to(&mut rig.keys, overrides)?;
    Ok(rig)
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
        scene.warnings.push(format!(
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

/// Returns the rig that [`viewpoint::find`] chooses, and warns that the file has no camera.
fn found_rig(scene: &mut Scene, metres_per_unit: f64, yfov_rad: Option<f64>, budget: &Budget) -> Rig {
    let Viewpoint { rig, is_inside } = viewpoint::find(scene, metres_per_unit, yfov_rad, budget);
    let RigKey { position, target, .. } = rig.keys[0];
    let place = if is_inside { "inside the scene" } else { "in front of the scene" };
    scene.warnings.push(format!(
        "no camera in the file: placed the viewpoint {place} at {position:.3}, looking at {target:.3}; choose a \
         position and a target, or write a shot, to change it"
    ));
    rig
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
mod tests {
    use glam::{Affine3A, DQuat};

    use super::super::motion::keys::{Interpolation, Keys};
    use super::super::motion::{Animation, Attached, Channel, Node, Placement, Target};
    use super::super::rig::{self, Eye};
    use super::super::shot::SceneSource;
    use super::super::{Instance, Light, LightKind, Material, Mesh};
    use super::*;

    fn triangle() -> Scene {
        let mesh =
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let instance = Instance { mesh: 0, world_from_local: Affine3A::IDENTITY };
        let (meshes, instances, materials) = (vec![mesh], vec![instance], vec![Material::default()]);
        Scene { meshes, instances, materials, ..Scene::empty("triangle") }
    }

    fn light() -> Light {
        Light { kind: LightKind::Point { position: Vec3::ONE, radius: 0.0 }, strength: Vec3::ONE }
    }

    fn camera(x: f32) -> Camera {
        Camera { world_from_view: Affine3A::from_translation(Vec3::new(x, 0.0, 3.0)), yfov_rad: 0.5 }
    }

    fn bare() -> Draft {
        Draft::of(SceneSource::File("chair.glb".into()), "chair".into())
    }

    fn completed(draft: Draft, overrides: &Overrides, scene: &mut Scene) -> Result<Shot, SceneError> {
        complete(draft, overrides, scene, &Motion::default(), &Budget::unlimited())
    }

    fn plain(draft: Draft, scene: &mut Scene) -> Shot {
        completed(draft, &Overrides::default(), scene).unwrap()
    }

    const KEY: &str = "[[rig.key]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n";

    fn draft(tables: &str) -> Draft {
        Draft::parse(&format!("scene = 'chair.glb'\n{tables}"), "chair.toml").unwrap()
    }

    #[test]
    fn a_bare_scene_is_looked_at_and_lit_white() {
        let mut scene = triangle();
        let shot = plain(bare(), &mut scene);
        assert!(matches!(&shot.environment, Some(e) if e.sky == Sky::Constant(Vec3::ONE)), "{shot:?}");
        assert_eq!(shot.rig, viewpoint::find(&scene, 1.0, None, &Budget::unlimited()).rig);
        assert!(matches!(&scene.warnings[..], [said] if said.contains("no camera")), "{:?}", scene.warnings);
    }

    #[test]
    fn a_scene_with_light_or_camera_keeps_them() {
        let mut scene = triangle();
        scene.cameras.push(camera(0.0));
        scene.lights.push(light());
        let shot = plain(bare(), &mut scene);
        assert_eq!((&shot.rig, &shot.environment), (&Rig::from_camera(camera(0.0)), &None));
        assert!(scene.warnings.is_empty());

        let mut emissive = triangle();
        emissive.materials[0].emissive = Vec3::X;
        assert!(plain(bare(), &mut emissive).environment.is_some());
    }

    #[test]
    fn a_shot_of_a_scene_alone_is_the_scene_without_a_shot() {
        let changes: [fn(&mut Scene); 3] = [|_| (), |s| s.lights.push(light()), |s| s.cameras.push(camera(1.0))];
        for change in changes {
            let [mut a, mut b] = [triangle(), triangle()];
            change(&mut a);
            change(&mut b);
            assert_eq!(plain(bare(), &mut a), plain(draft(""), &mut b));
        }
    }

    #[test]
    fn what_a_shot_says_of_its_rig_goes_before_what_is_found() {
        let rig = "[rig]\nyfov_deg = 90\nbaseline_m = 0.5\nmetres_per_unit = 0.01";
        let shot = plain(draft(rig), &mut triangle());
        let found = viewpoint::find(&triangle(), 0.01, Some(90f64.to_radians()), &Budget::unlimited()).rig;
        assert_eq!(shot.rig, Rig { baseline_m: 0.5, ..found });

        let mut scene = triangle();
        scene.cameras.push(camera(0.0));
        let rig = plain(draft(rig), &mut scene).rig;
        assert_eq!((rig.yfov_rad, rig.baseline_m, rig.metres_per_unit), (90f64.to_radians(), 0.5, 0.01));
        assert_eq!(rig.keys, Rig::from_camera(camera(0.0)).keys);
    }

    /// Such a shot gets no white environment, since emissive surfaces may be meant as its only light.
    #[test]
    fn a_shot_with_a_camera_or_light_of_its_own_is_lit_by_what_it_names() {
        for tables in [KEY, "[[light]]\nkind = 'point'\nposition = [0, 1, 0]"] {
            assert_eq!(plain(draft(tables), &mut triangle()).environment, None, "{tables}");
        }
    }

    #[test]
    fn what_is_asked_for_goes_before_what_the_shot_says() {
        let wanted = Overrides {
            yfov_rad: Some(1.0),
            baseline_m: Some(0.1),
            exposure_ev: Some(2.0),
            environment: Some(ShotEnvironment { sky: Sky::Constant(Vec3::X), scale: 1.0, rotation_deg: 0.0 }),
            ..Overrides::default()
        };
        let said = format!("[rig]\nyfov_deg = 20\nbaseline_m = 1\n{KEY}[exposure]\nev = -1\n[environment]");
        let shot = completed(draft(&said), &wanted, &mut triangle()).unwrap();
        assert_eq!((shot.rig.yfov_rad, shot.rig.baseline_m, shot.exposure_ev), (1.0, 0.1, 2.0));
        assert_eq!(shot.environment, wanted.environment);
    }

    #[test]
    fn eyes_are_moved_and_turned() {
        let to = |position, target| Overrides { position, target, ..Overrides::default() };
        let path = format!("{KEY}[[rig.key]]\ntime_s = 1\nposition = [1, 0, 1]\ntarget = [1, 0, 0]");
        let at = |overrides: &Overrides, draft: Draft| completed(draft, overrides, &mut triangle()).map(|s| s.rig.keys);
        let up_there = DVec3::new(0.0, 5.0, 0.0);

        let moved = at(&to(Some(up_there), None), draft(&path)).unwrap();
        assert!(moved.iter().all(|key| key.position == up_there));
        assert_eq!(moved[1].target, DVec3::X);
        let turned = at(&to(None, Some(up_there)), draft(&path)).unwrap();
        assert!(turned.iter().all(|key| key.target == up_there) && turned[1].position == DVec3::new(1.0, 0.0, 1.0));

        let mut scene = triangle();
        let down = completed(bare(), &to(Some(up_there), Some(DVec3::ZERO)), &mut scene).unwrap().rig;
        assert_eq!((down.keys[0].up, down.yfov_rad), (DVec3::NEG_Z, rig::DEFAULT_YFOV_DEG.to_radians()));
        assert!(scene.warnings.is_empty(), "nothing was looked for: {:?}", scene.warnings);

        let error = at(&to(Some(DVec3::ONE), Some(DVec3::ONE)), draft(&path)).unwrap_err().to_string();
        assert!(error.contains("the view") && error.contains("same point"), "{error}");
    }

    #[test]
    fn a_camera_is_chosen_by_its_number() {
        let camera_of = |number, scene: &mut Scene| {
            completed(draft(KEY), &Overrides { camera: Some(number), ..Overrides::default() }, scene)
        };
        let mut scene = triangle();
        assert!(camera_of(0, &mut scene).unwrap_err().to_string().contains("no camera"));
        scene.cameras.extend([camera(0.0), camera(1.0)]);
        assert_eq!(camera_of(1, &mut scene).unwrap().rig, Rig::from_camera(camera(1.0)));
        assert!(camera_of(2, &mut scene).unwrap_err().to_string().contains("cameras 0 to 1"));
        assert!(scene.warnings.is_empty());
        assert_eq!(plain(bare(), &mut scene).rig, Rig::from_camera(camera(0.0)));
        assert!(scene.warnings[0].contains("chosen by its number, 0 to 1"), "{:?}", scene.warnings);
    }

    #[test]
    fn eyes_follow_a_camera_that_moves() {
        let keys = Keys::new(vec![0.0, 2.0], vec![0.0, 0.0, 3.0, 4.0, 0.0, 3.0], 3, Interpolation::Linear).unwrap();
        let channels = vec![Channel { target: Target::Translation(0), keys }];
        let rest = Placement::Parts { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
        let mut motion = Motion {
            nodes: vec![Node { name: String::new(), parent: None, rest }],
            animations: vec![Animation { name: String::new(), channels, duration_s: 2.0 }],
            cameras: vec![Attached { index: 0, node: 0 }],
            loops: true,
            ..Motion::default()
        };
        let mut scene = triangle();
        scene.cameras.push(camera(0.0));
        let mut rig_of = |motion: &Motion, overrides: &Overrides| {
            complete(bare(), overrides, &mut scene, motion, &Budget::unlimited()).unwrap().rig
        };
        let at_1s = Overrides { time_s: 1.0, ..Overrides::default() };
        let x = |rig: &Rig, time_s| {
            let [left, right] = Eye::ALL.map(|eye| rig.view(time_s, eye).origin.x);
            (left + right) / 2.0
        };
        let rig = rig_of(&motion, &at_1s);
        for (time_s, expected) in [(1.0, 2.0), (1.5, 3.0), (3.0, 2.0), (21.25, 2.5)] {
            assert!((x(&rig, time_s) - expected).abs() < 1e-4, "{time_s} s: {}", x(&rig, time_s));
        }
        motion.loops = false;
        let rig = rig_of(&motion, &at_1s);
        assert!((x(&rig, 9.0) - 4.0).abs() < 1e-4 && rig.keys.len() == 61);
        let stays = Overrides { position: Some(DVec3::Z), target: Some(DVec3::ZERO), ..at_1s };
        assert!(rig_of(&motion, &stays).keys.iter().all(|key| key.position == DVec3::Z));
    }

    #[test]
    fn a_baseline_that_no_number_holds_is_refused() {
        let wide = Overrides { baseline_m: Some(1e38), ..Overrides::default() };
        let error = completed(draft("[rig]\nmetres_per_unit = 1e-6"), &wide, &mut triangle()).unwrap_err();
        assert!(error.to_string().contains("the baseline"), "{error}");
    }
}
