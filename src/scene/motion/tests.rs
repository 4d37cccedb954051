//! Tests of keys, hierarchies, skins and morphs against values worked out by hand.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{Affine3A, DAffine3, DMat3, DQuat, DVec3, Quat, Vec3, Vec4};

use super::bake::deformed;
use super::keys::{Interpolation, Keys, KeysError};
use super::*;
use crate::scene::{Camera, Instance, Light, LightKind, Material, Mesh, Scene};

fn keys(times_s: &[f32], values: &[f32], width: usize, interpolation: Interpolation) -> Keys {
    Keys::new(times_s.to_vec(), values.to_vec(), width, interpolation).unwrap()
}

#[test]
fn steps_hold_and_lines_go_straight() {
    let step = keys(&[1.0, 2.0, 4.0], &[1.0, 2.0, 3.0], 1, Interpolation::Step);
    let line = keys(&[1.0, 2.0, 4.0], &[1.0, 2.0, 3.0], 1, Interpolation::Linear);
    let cases =
        [(0.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.75, 1.0, 1.75), (2.0, 2.0, 2.0), (3.0, 2.0, 2.5), (9.0, 3.0, 3.0)];
    for (time_s, stepped, linear) in cases {
        assert_eq!((step.at(time_s), line.at(time_s)), (vec![stepped], vec![linear]), "{time_s}");
    }
    let two = keys(&[0.0, 1.0], &[0.0, 10.0, 4.0, 20.0], 2, Interpolation::Linear);
    assert_eq!(two.at(0.25), [1.0, 12.5]);
    assert_eq!(two.end_s(), 1.0);
}

/// A cubic spline reproduces a cubic from its values and slopes.
#[test]
fn splines_are_cubics() {
    let cubic = |t: f64| 2.0 * t.powi(3) - 3.0 * t * t + 0.5 * t + 7.0;
    let slope = |t: f64| 6.0 * t * t - 6.0 * t + 0.5;
    let (a, b) = (1.0, 3.5);
    let values = [0.0, cubic(a), slope(a), slope(b), cubic(b), 0.0].map(|v| v as f32);
    let spline = keys(&[a as f32, b as f32], &values, 1, Interpolation::CubicSpline);
    for i in 0..=20 {
        let t = a + (b - a) * f64::from(i) / 20.0;
        assert!((spline.at(t)[0] - cubic(t)).abs() < 1e-4, "{t}");
    }
    assert_eq!((spline.at(0.0)[0], spline.at(4.0)[0]), (f64::from(values[1]), f64::from(values[4])));
}

#[test]
fn rotations_take_the_shortest_way_at_constant_speed() {
    let turn = |angle: f64| DQuat::from_rotation_y(angle).as_quat().to_array();
    let (from, to) = (turn(0.2), turn(2.2));
    for to in [to, to.map(|c| -c)] {
        let keys = keys(&[0.0, 2.0], &[from, to].concat(), 4, Interpolation::Linear);
        for i in 0..=8 {
            let s = f64::from(i) / 8.0;
            let found = keys.rotation_at(2.0 * s);
            assert!(found.is_normalized() && found.angle_between(DQuat::from_rotation_y(0.2 + 2.0 * s)) < 1e-6, "{s}");
        }
    }
    let spline = [[0.0; 4], turn(0.0), [0.0; 4], [0.0; 4], turn(1.0), [0.0; 4]].concat();
    let spline = keys(&[0.0, 1.0], &spline, 4, Interpolation::CubicSpline);
    let half = spline.rotation_at(0.5);
    assert!(half.is_normalized() && half.angle_between(DQuat::from_rotation_y(0.5)) < 1e-6);
}

#[test]
fn rejects_invalid_keys() {
    let of = |times: &[f32], values: &[f32], kind| Keys::new(times.to_vec(), values.to_vec(), 1, kind).unwrap_err();
    use Interpolation::{CubicSpline, Linear};
    assert_eq!(of(&[], &[], Linear), KeysError::Empty);
    assert_eq!(of(&[0.0, f32::NAN], &[0.0; 2], Linear), KeysError::Time(1));
    assert_eq!(of(&[-1.0], &[0.0], Linear), KeysError::Time(0));
    assert_eq!(of(&[0.0, 1.0, 1.0], &[0.0; 3], Linear), KeysError::Order(2));
    assert_eq!(of(&[0.0, 1.0], &[0.0; 3], Linear), KeysError::Count { keys: 2, values: 3, expected: 2 });
    assert_eq!(of(&[0.0, 1.0], &[0.0; 2], CubicSpline), KeysError::Count { keys: 2, values: 2, expected: 6 });
    assert_eq!(of(&[0.0, 1.0], &[0.0, f32::INFINITY], Linear), KeysError::Value(1));
}

fn node(parent: Option<usize>, translation: DVec3) -> Node {
    let rest = Placement::Parts { translation, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
    Node { name: String::new(), parent, rest }
}

/// Returns an animation that rotates node `of` by a right angle around z in two seconds.
fn turning(of: usize) -> Animation {
    let ends = [DQuat::IDENTITY, DQuat::from_rotation_z(FRAC_PI_2)].map(|q| q.as_quat().to_array());
    let keys = keys(&[0.0, 2.0], &ends.concat(), 4, Interpolation::Linear);
    Animation { name: "turn".into(), channels: vec![Channel { target: Target::Rotation(of), keys }], duration_s: 2.0 }
}

fn triangle() -> Mesh {
    Mesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: vec![Vec3::Z; 3],
        tangents: vec![Vec4::new(1.0, 0.0, 0.0, 1.0); 3],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    }
}

fn scene(mesh: Mesh, motion: Motion) -> Scene {
    Scene {
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_local: Affine3A::IDENTITY }],
        materials: vec![Material::default()],
        motion,
        ..Scene::empty("test")
    }
}

#[test]
fn hierarchy_moves_its_bodies_lights_and_cameras() {
    let motion = Motion {
        nodes: vec![node(None, DVec3::X), node(Some(0), DVec3::X), node(Some(1), DVec3::Y)],
        animations: vec![turning(0)],
        bodies: vec![Body { instance: 0, node: 1, skin: None, weights: vec![] }],
        lights: vec![Attached { index: 0, node: 2 }],
        cameras: vec![Attached { index: 0, node: 2 }],
        loops: true,
        ..Motion::default()
    };
    let mut scene = scene(triangle(), motion);
    let kind =
        LightKind::Spot { position: Vec3::ZERO, radius: 0.5, direction: Vec3::X, cos_inner: 1.0, cos_outer: 0.5 };
    scene.lights.push(Light { kind, strength: Vec3::ONE });
    scene.cameras.push(Camera { world_from_view: Affine3A::IDENTITY, yfov_rad: 1.0 });
    let close = |a: Vec3, b: [f32; 3]| assert!(a.distance(b.into()) < 1e-6, "{a}");
    // After one second, the rotation is half done.
    let h = std::f32::consts::FRAC_1_SQRT_2;
    for (time_s, place, lamp) in [
        (0.0, [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]),
        (1.0, [1.0 + h, h, 0.0], [1.0, 2.0 * h, 0.0]),
        (3.0, [1.0 + h, h, 0.0], [1.0, 2.0 * h, 0.0]),
        (-1.0, [1.0 + h, h, 0.0], [1.0, 2.0 * h, 0.0]),
    ] {
        let still = scene.at(time_s);
        assert!(still.motion.is_empty());
        close(still.instances[0].world_from_local.translation.into(), place);
        let LightKind::Spot { position, radius, direction, .. } = still.lights[0].kind else { panic!() };
        close(position, lamp);
        close(direction, [0.0, 0.0, -1.0]);
        assert_eq!(radius, 0.5);
        close(still.cameras[0].world_from_view.translation.into(), lamp);
    }
    scene.motion.loops = false;
    close(scene.at(99.0).instances[0].world_from_local.translation.into(), [1.0, 1.0, 0.0]);
    for time_s in [f64::NAN, f64::INFINITY, -5.0] {
        close(scene.at(time_s).instances[0].world_from_local.translation.into(), [2.0, 0.0, 0.0]);
    }
    scene.motion.animations[0].duration_s = 0.0;
    scene.motion.loops = true;
    close(scene.at(1.0).instances[0].world_from_local.translation.into(), [2.0, 0.0, 0.0]);
    let moves = scene.motion.moves().unwrap();
    assert_eq!((moves.rigid_instances, moves.nodes, moves.lights, moves.cameras), (1, 3, 1, 1));
}

fn influence(pairs: &[(u16, f32)]) -> Influence {
    let mut influence = Influence::default();
    for (i, &(joint, weight)) in pairs.iter().enumerate() {
        (influence.joints[i], influence.weights[i]) = (joint, weight);
    }
    influence
}

#[test]
fn skinned_vertices_are_the_mean_of_their_joints() {
    let mut mesh = triangle();
    mesh.influences = vec![influence(&[(0, 1.0)]), influence(&[(1, 1.0)]), influence(&[(0, 0.5), (1, 0.5)])];
    let motion = Motion {
        nodes: vec![node(None, DVec3::ZERO), node(Some(0), DVec3::X)],
        animations: vec![turning(1)],
        skins: vec![Skin {
            joints: vec![0, 1],
            inverse_bind: vec![Affine3A::IDENTITY, Affine3A::from_translation(Vec3::NEG_X)],
        }],
        bodies: vec![Body { instance: 0, node: 0, skin: Some(0), weights: vec![] }],
        ..Motion::default()
    };
    let scene = scene(mesh, motion);
    assert_eq!(scene.at(0.0).meshes[0].positions, triangle().positions);
    let still = scene.at(2.0);
    // The second joint turns by a right angle around (1, 0, 0), which maps (0, 1, 0) to (0, -1, 0).
    let expected = [Vec3::ZERO, Vec3::X, Vec3::ZERO];
    for (found, expected) in still.meshes[0].positions.iter().zip(expected) {
        assert!(found.distance(expected) < 1e-6, "{found}");
    }
    assert!(still.meshes[0].normals.iter().all(|n| n.distance(Vec3::Z) < 1e-6));
    assert!(still.meshes[0].tangents[1].distance(Vec4::new(0.0, 1.0, 0.0, 1.0)) < 1e-6);
    assert!(still.meshes[0].influences.is_empty() && !scene.meshes[0].influences.is_empty());
    assert_eq!(scene.motion.joints(&scene.motion.pose(0.0), 0), [DAffine3::IDENTITY; 2]);
    assert!(scene.motion.joints(&scene.motion.pose(0.0), 7).is_empty());
}

#[test]
fn skinning_transforms_normals_and_winding() {
    let mut mesh = triangle();
    mesh.normals = vec![Vec3::new(1.0, 1.0, 1.0).normalize(); 3];
    mesh.influences = vec![influence(&[(0, 1.0)]); 3];
    let stretch = DMat3::from_diagonal(DVec3::new(4.0, 1.0, 2.0));
    let shape = deformed(&mesh, &[], Some(&[DAffine3::from_mat3(stretch)]));
    let expected = Vec3::new(0.25, 1.0, 0.5).normalize();
    assert!(shape.normals[0].distance(expected) < 1e-6, "{}", shape.normals[0]);
    assert_eq!(shape.triangles, mesh.triangles);
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let shape = deformed(&mesh, &[], Some(&[mirror]));
    assert_eq!((shape.triangles[0], shape.tangents[0]), ([0, 2, 1], Vec4::new(-1.0, 0.0, 0.0, -1.0)));
    assert!(shape.normals[0].distance(Vec3::new(-1.0, 1.0, 1.0).normalize()) < 1e-6);
    // A joint scaled to zero collapses positions to a point, and keeps normals.
    let shape = deformed(&mesh, &[], Some(&[DAffine3::ZERO]));
    assert_eq!((shape.positions[1], shape.normals[1]), (Vec3::ZERO, mesh.normals[1]));
}

#[test]
fn morphs_are_added_by_their_weights() {
    let mut mesh = triangle();
    mesh.morphs = vec![
        Morph { positions: vec![Vec3::Z; 3], normals: vec![Vec3::X; 3], tangents: vec![Vec3::Y; 3] },
        Morph { positions: vec![Vec3::X, Vec3::ZERO, Vec3::ZERO], ..Morph::default() },
    ];
    let shape = deformed(&mesh, &[0.5, 2.0], None);
    assert_eq!(shape.positions, [Vec3::new(2.0, 0.0, 0.5), Vec3::new(1.0, 0.0, 0.5), Vec3::new(0.0, 1.0, 0.5)]);
    assert!(shape.normals[0].distance(Vec3::new(0.5, 0.0, 1.0).normalize()) < 1e-6);
    assert!(shape.tangents[0].distance(Vec3::new(1.0, 0.5, 0.0).normalize().extend(1.0)) < 1e-6);
    assert_eq!(deformed(&mesh, &[0.0, 0.0], None).positions, mesh.positions);

    // Animates the weights of two bodies that share a mesh; a third instance is static.
    let target = Target::Weights(0);
    let keys = keys(&[0.0, 1.0], &[0.0, 0.0, 1.0, 0.0], 2, Interpolation::Linear);
    let body = |instance| Body { instance, node: 0, skin: None, weights: vec![0.0; 2] };
    let motion = Motion {
        nodes: vec![node(None, DVec3::ZERO)],
        animations: vec![Animation { name: String::new(), channels: vec![Channel { target, keys }], duration_s: 1.0 }],
        bodies: vec![body(0), body(1)],
        ..Motion::default()
    };
    let mut scene = scene(mesh, motion);
    scene.instances = vec![scene.instances[0]; 3];
    let still = scene.at(0.5);
    let heights = still.instances.iter().map(|i| still.meshes[i.mesh].positions[0].z);
    assert_eq!(heights.collect::<Vec<_>>(), [0.5, 0.5, 0.0]);
    assert!(still.meshes.iter().all(|m| m.morphs.is_empty()) && scene.bytes_at() > 0);
}

#[test]
fn transforms_beyond_all_numbers_stay_finite() {
    let mut vast = node(Some(0), DVec3::splat(1e38));
    vast.rest = Placement::Matrix(DAffine3::from_scale(DVec3::splat(3e38)));
    let motion = Motion {
        nodes: vec![node(None, DVec3::X), vast.clone(), Node { parent: Some(1), ..vast }],
        bodies: vec![Body { instance: 0, node: 2, skin: None, weights: vec![] }],
        ..Motion::default()
    };
    let pose = motion.pose(0.0);
    assert!(pose.world_from_node.iter().all(|m| m.is_finite()));
    assert_eq!(pose.world_from_node[2], pose.world_from_node[1]);
    let mut mesh = triangle();
    mesh.influences = vec![influence(&[(0, 1.0)]); 3];
    mesh.positions[1] = Vec3::MAX;
    let shape = deformed(&mesh, &[], Some(&[DAffine3::from_scale(DVec3::splat(1e38))]));
    assert!(shape.positions.iter().all(|p| p.is_finite()));
}

#[test]
fn materials_and_lights_change() {
    let channel = |target, width, values: &[f32]| Channel {
        target,
        keys: keys(&[0.0, 1.0], values, width, Interpolation::Linear),
    };
    let emitter = Emitter { index: 0, color: Vec3::X, strength: 3.0 };
    let motion = Motion {
        animations: vec![Animation {
            name: String::new(),
            channels: vec![
                channel(Target::BaseColor(0), 4, &[0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 1.0, 1.0]),
                channel(Target::EmissiveStrength(0), 1, &[2.0, 4.0]),
                channel(Target::LightColor(0), 3, &[0.0, 0.0, 0.0, 1.0, 1.0, -1.0]),
            ],
            duration_s: 1.0,
        }],
        emitters: vec![emitter],
        lamps: vec![emitter],
        ..Motion::default()
    };
    let mut scene = scene(triangle(), motion);
    scene.lights.push(Light { kind: LightKind::Point { position: Vec3::ONE, radius: 0.0 }, strength: Vec3::ONE });
    let still = scene.at(0.5);
    assert_eq!(still.materials[0].base_color, Vec4::new(0.5, 1.0, 0.5, 1.0));
    assert_eq!(still.materials[0].emissive, Vec3::new(3.0, 0.0, 0.0));
    assert_eq!(still.lights[0].strength, Vec3::new(1.5, 1.5, 0.0));
}

#[test]
fn shot_moves_its_lights() {
    use super::play::{Move, MoveKey, Moved, Play};
    let turned = |time_s, degrees: f64| MoveKey {
        time_s,
        position: Some(DVec3::X * time_s),
        rotation_deg: Some(DVec3::new(degrees, 0.0, 0.0)),
        scale: None,
    };
    let moved = Move { of: Moved::Light(0), keys: vec![turned(0.0, 0.0), turned(2.0, -90.0)] };
    let play = Play { moves: vec![moved], loops: false, ..Play::default() };
    let mut scene = scene(triangle(), Motion::default());
    let kind = LightKind::Spot { position: Vec3::Y, radius: 0.0, direction: Vec3::Y, cos_inner: 1.0, cos_outer: 0.0 };
    scene.lights = vec![Light { kind, strength: Vec3::ONE }; 2];
    play.move_lights(&mut scene, 1);
    let LightKind::Spot { position, direction, .. } = scene.at(7.0).lights[1].kind else { panic!() };
    assert!(position.distance(Vec3::new(2.0, 0.0, 0.0)) < 1e-6 && direction.distance(Vec3::NEG_Y) < 1e-6);
    assert_eq!(scene.at(7.0).lights[0].kind, kind);
    let quarter = Quat::from_rotation_x((-PI / 4.0) as f32) * Vec3::NEG_Z;
    let LightKind::Spot { direction, .. } = scene.at(1.0).lights[1].kind else { panic!() };
    assert!(direction.distance(quarter) < 1e-6);
}
