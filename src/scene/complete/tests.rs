use glam::{Affine3A, DQuat};

use super::*;
use crate::scene::motion::keys::{Interpolation, Keys};
use crate::scene::motion::{Animation, Attached, Channel, Node, Placement, Target};
use crate::scene::rig::{self, Eye};
use crate::scene::shot::SceneSource;
use crate::scene::{Instance, Light, LightKind, Material, Mesh};

fn triangle() -> Scene {
    let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
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
fn bare_scene_gets_a_viewpoint_and_white_light() {
    let mut scene = triangle();
    let shot = plain(bare(), &mut scene);
    assert!(matches!(&shot.environment, Some(e) if e.sky == Sky::Constant(Vec3::ONE)), "{shot:?}");
    assert_eq!(shot.rig, viewpoint::find(&scene, &Wanted::default(), &Budget::unlimited()).rig);
    assert!(matches!(&scene.notes[..], [said] if said.contains("no camera")), "{:?}", scene.notes);
}

#[test]
fn studio_look_lights_files_without_lights() {
    let studio = Overrides { look: Look::Studio, ..Overrides::default() };
    let sky = |change: fn(&mut Scene)| {
        let mut scene = triangle();
        change(&mut scene);
        completed(bare(), &studio, &mut scene).unwrap().environment.map(|e| e.sky)
    };
    assert_eq!(sky(|_| ()), Some(Sky::Studio));
    assert_eq!(sky(|s| s.materials[0].emissive = Vec3::X), Some(Sky::Studio));
    assert_eq!(sky(|s| s.lights.push(light())), None);
}

#[test]
fn scene_keeps_its_light_and_camera() {
    let mut scene = triangle();
    scene.cameras.push(camera(0.0));
    scene.lights.push(light());
    let shot = plain(bare(), &mut scene);
    assert_eq!((&shot.rig, &shot.environment), (&Rig::from_camera(camera(0.0)), &None));
    assert!(scene.notes.is_empty());

    let mut emissive = triangle();
    emissive.materials[0].emissive = Vec3::X;
    assert!(plain(bare(), &mut emissive).environment.is_some());
}

#[test]
fn empty_shot_equals_the_bare_scene() {
    let changes: [fn(&mut Scene); 3] = [|_| (), |s| s.lights.push(light()), |s| s.cameras.push(camera(1.0))];
    for change in changes {
        let [mut a, mut b] = [triangle(), triangle()];
        change(&mut a);
        change(&mut b);
        assert_eq!(plain(bare(), &mut a), plain(draft(""), &mut b));
    }
}

#[test]
fn rig_of_a_shot_overrides_the_found_viewpoint() {
    let rig = "[rig]\nyfov_deg = 90\nbaseline_m = 0.5\nmetres_per_unit = 0.01";
    let shot = plain(draft(rig), &mut triangle());
    let wanted = Wanted { metres_per_unit: 0.01, yfov_rad: Some(90f64.to_radians()), ..Wanted::default() };
    let found = viewpoint::find(&triangle(), &wanted, &Budget::unlimited()).rig;
    assert_eq!(shot.rig, Rig { baseline_m: 0.5, ..found });

    let mut scene = triangle();
    scene.cameras.push(camera(0.0));
    let rig = plain(draft(rig), &mut scene).rig;
    assert_eq!((rig.yfov_rad, rig.baseline_m, rig.metres_per_unit), (90f64.to_radians(), 0.5, 0.01));
    assert_eq!(rig.keys, Rig::from_camera(camera(0.0)).keys);
}

/// A closed room of 3 x 2.5 x 8 units with a corner at the origin, without light.
fn closed_room() -> Scene {
    let mut room = triangle();
    let corner = |i: u32| Vec3::new(3.0 * (i & 1) as f32, 2.5 * (i >> 1 & 1) as f32, 8.0 * (i >> 2) as f32);
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let inwards = quads.iter().flat_map(|&[a, b, c, d]: &[u32; 4]| [[a, c, b], [a, d, c]]);
    room.meshes[0] = Mesh { positions: (0..8).map(corner).collect(), triangles: inwards.collect(), ..Mesh::default() };
    room
}

#[test]
fn closed_room_gets_a_light_in_the_studio_look() {
    let mut room = closed_room();
    let overrides = Overrides { look: Look::Studio, ..Overrides::default() };
    let shot = completed(bare(), &overrides, &mut room).unwrap();
    assert_eq!(shot.lights.len(), 1);
    assert!(room.notes.iter().any(|w| w.contains("added a light at the camera")), "{:?}", room.notes);
    let plain = completed(bare(), &Overrides::default(), &mut room).unwrap();
    assert!(plain.lights.is_empty() && (plain.exposure_ev, plain.is_metered) == (0.0, false));
    assert!(shot.is_metered && shot.tone == ToneCurve::Neutral && plain.tone == ToneCurve::Reinhard);
}

#[test]
fn closed_room_gets_a_light_at_inner_viewpoints() {
    let studio = Overrides { look: Look::Studio, ..Overrides::default() };
    let lights = |overrides: &Overrides, change: fn(&mut Scene)| {
        let mut room = closed_room();
        change(&mut room);
        let is_told = |room: &Scene| room.notes.iter().any(|note| note.contains("added a light at the camera"));
        let lights = completed(bare(), overrides, &mut room).unwrap().lights;
        assert_eq!(lights.len(), usize::from(is_told(&room)), "{:?}", room.notes);
        lights
    };
    let inside = DVec3::new(1.5, 1.2, 4.0);
    let below_the_ceiling = DVec3::new(1.5, 2.49, 4.0);
    for position in [inside, below_the_ceiling] {
        for target in [None, Some(DVec3::ZERO)] {
            let overrides = Overrides { position: Some(position), target, ..studio.clone() };
            let [light] = &lights(&overrides, |_| ())[..] else { panic!("no light at {position}") };
            let ShotLightKind::Point { position: lamp, .. } = light.kind else { panic!("{light:?}") };
            assert!(lamp.y > position.y as f32 && lamp.y < 2.5, "{lamp} in a room of height 2.5");
        }
    }
    let camera_inside = |room: &mut Scene| {
        room.cameras.push(Camera { world_from_view: Affine3A::from_translation(Vec3::ONE), ..camera(0.0) })
    };
    assert_eq!(lights(&studio, camera_inside).len(), 1, "a camera of the file");
    let outside = Overrides { position: Some(DVec3::new(1.5, 1.2, 12.0)), ..studio.clone() };
    assert!(lights(&outside, |_| ()).is_empty(), "outside");
    let orbit = Overrides { orbit: Some(Orbit::FRONT), ..studio.clone() };
    assert!(lights(&orbit, |_| ()).is_empty(), "from outside");
    let inside = Overrides { position: Some(inside), ..studio };
    assert!(lights(&inside, |room| room.lights.push(light())).is_empty(), "a light of the file");
}

/// Such a shot gets no white environment, since emissive surfaces may be meant as its only light.
#[test]
fn shot_with_camera_or_light_gets_no_environment() {
    for tables in [KEY, "[[light]]\nkind = 'point'\nposition = [0, 1, 0]"] {
        assert_eq!(plain(draft(tables), &mut triangle()).environment, None, "{tables}");
    }
}

#[test]
fn overrides_take_precedence_over_the_shot() {
    let wanted = Overrides {
        yfov_rad: Some(1.0),
        baseline_m: Some(0.1),
        exposure: Some(Exposure::Ev(2.0)),
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
    assert!(scene.notes.is_empty(), "nothing was looked for: {:?}", scene.notes);

    let error = at(&to(Some(DVec3::ONE), Some(DVec3::ONE)), draft(&path)).unwrap_err().to_string();
    assert!(error.contains("the view") && error.contains("same point"), "{error}");
}

#[test]
fn camera_is_chosen_by_its_number() {
    let camera_of = |number, scene: &mut Scene| {
        completed(draft(KEY), &Overrides { camera: Some(number), ..Overrides::default() }, scene)
    };
    let mut scene = triangle();
    assert!(camera_of(0, &mut scene).unwrap_err().to_string().contains("no camera"));
    scene.cameras.extend([camera(0.0), camera(1.0)]);
    assert_eq!(camera_of(1, &mut scene).unwrap().rig, Rig::from_camera(camera(1.0)));
    assert!(camera_of(2, &mut scene).unwrap_err().to_string().contains("cameras 0 to 1"));
    assert!(scene.notes.is_empty());
    assert_eq!(plain(bare(), &mut scene).rig, Rig::from_camera(camera(0.0)));
    assert!(scene.notes[0].contains("chosen by its number, 0 to 1"), "{:?}", scene.notes);
}

#[test]
fn eyes_follow_an_animated_camera() {
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
        let [left, right] = Eye::BOTH.map(|eye| rig.view(time_s, eye).origin.x);
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
fn rejects_baselines_beyond_f32() {
    let wide = Overrides { baseline_m: Some(1e38), ..Overrides::default() };
    let error = completed(draft("[rig]\nmetres_per_unit = 1e-6"), &wide, &mut triangle()).unwrap_err();
    assert!(error.to_string().contains("the baseline"), "{error}");
}
