//! No surface and no image in a mirror moves by more rows than the bounds say.

use glam::{Affine3A, DAffine3, DQuat};

use super::*;
use crate::accel::Accel;
use crate::image::Extent;
use crate::projection::{LogPolar, PolarSpace};
use crate::scene::motion::keys::{Interpolation, Keys};
use crate::scene::motion::{Animation, Body, Channel, Influence, Node, Placement, Skin, Target};
use crate::scene::rig::{Eye, Rig, RigKey};
use crate::scene::{Instance, Material, Mesh, Scene, builtin};

fn eyes(rig: &Rig, time_s: f64) -> [View; 2] {
    Eye::BOTH.map(|eye| View::new(&rig.view(time_s, eye), 16.0 / 9.0))
}

fn rig(to: DVec3, turned: DVec3) -> Rig {
    let key = |time_s, position, target| RigKey { time_s, position, target, up: DVec3::Y };
    let position = DVec3::new(0.0, 1.0, 3.0);
    let keys = vec![key(0.0, position, DVec3::Y), key(1.0, position + to, DVec3::Y + to + turned)];
    Rig { yfov_rad: 1.2, ..Rig::of_keys(keys) }
}

#[test]
fn no_point_beyond_the_clearance_moves_by_more_rows() {
    let moves = [DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.05, DVec3::new(0.03, -0.02, -0.2)];
    for (to, turned) in moves.into_iter().flat_map(|m| [(m, DVec3::ZERO), (m, DVec3::new(0.1, 0.2, 0.0))]) {
        let rig = rig(to, turned);
        let (now, before) = (eyes(&rig, 1.0), eyes(&rig, 0.0));
        let camera =
            Camera { views: now, width: 160, height: 90, centre: glam::Vec2::splat(0.5), ..Default::default() };
        let clearance = 0.7;
        let bounds = [0.0, 1.0 / clearance].map(|n| most_rows(&camera, &before, [n; 2]).unwrap());
        let bound = bounds[0].max(bounds[1]);
        let mut most: f64 = 0.0;
        for i in 0..20_000 {
            let part = |k: f64| (f64::from(i) * k).fract();
            let (column, row) = ((part(0.618) * 160.0).floor() + 0.5, (part(0.414) * 90.0).floor() + 0.5);
            let distance = clearance / part(0.732).max(1e-6);
            let view = rig.view(1.0, Eye::LEFT);
            let ray = view.ray_direction(column, row, Extent::new(160, 90));
            let p = view.origin.as_dvec3() + ray * distance - before[0].origin.as_dvec3();
            let z = p.dot(before[0].forward.as_dvec3());
            let up = p.dot(before[0].up.as_dvec3()) / (z * f64::from(before[0].tan_half_y));
            most = most.max(((0.5 - 0.5 * up) * 90.0 - row).abs());
        }
        assert!(most <= bound, "{to} {turned}: {most} rows, bound {bound}");
        assert!(bound <= 2.0 * most + 3.0, "{to} {turned}: a bound of {bound} for {most} rows is of no use");
    }
}

/// Makes a scene with two blocks that move at random. One of them is skinned to two joints.
fn moving_blocks(random: &mut impl FnMut() -> f64) -> Scene {
    let mut scene = builtin::find("cornell").unwrap().build();
    let mesh = scene.instances.last().unwrap().mesh;
    let mut skinned = scene.meshes[mesh].clone();
    let joint = |p: &Vec3| u16::from(p.x > scene.bounds().min.x + 1.0);
    let influence = |p| Influence { joints: [joint(p); 8], weights: [1.0, 0., 0., 0., 0., 0., 0., 0.] };
    skinned.influences = skinned.positions.iter().map(influence).collect();
    scene.meshes.push(skinned);
    let mut channels = Vec::new();
    for node in 0..3 {
        let rest = Placement::Parts { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
        scene.motion.nodes.push(Node { name: String::new(), parent: None, rest });
        let mut keys = |width: usize, by: f64| {
            let values = (0..2 * width).map(|_| (by * (random() - 0.5)) as f32).collect();
            Keys::new(vec![0.0, 1.0], values, width, Interpolation::Linear).unwrap()
        };
        channels.push(Channel { target: Target::Translation(node), keys: keys(3, 0.6) });
        let target = Target::Rotation(node);
        let mut turns = keys(4, 0.3).at(0.0);
        turns.extend(keys(4, 0.3).at(0.0));
        (turns[3], turns[7]) = (1.0, 1.0);
        let turns = turns.iter().map(|v| *v as f32).collect();
        channels.push(Channel { target, keys: Keys::new(vec![0.0, 1.0], turns, 4, Interpolation::Linear).unwrap() });
    }
    scene.motion.animations.push(Animation { name: String::new(), channels, duration_s: 1.0 });
    let inverse_bind = vec![Affine3A::IDENTITY; 2];
    scene.motion.skins.push(Skin { joints: vec![1, 2], inverse_bind });
    for (skin, mesh) in [(None, mesh), (Some(0), scene.meshes.len() - 1)] {
        let instance = scene.instances.len();
        scene.instances.push(Instance { mesh, world_from_local: Affine3A::IDENTITY });
        scene.motion.bodies.push(Body { instance, node: 0, skin, weights: Vec::new() });
    }
    scene
}

#[test]
fn bodies_move_within_the_row_bound() {
    let mut seed = 1u32;
    let mut random = || {
        seed = seed.wrapping_mul(0x915f_77f5).wrapping_add(0x6d2b_79f5);
        f64::from(seed >> 8) / f64::from(1u32 << 24)
    };
    let (mut tight, mut bounded) = (0, 0);
    for round in 0..40 {
        let scene = moving_blocks(&mut random);
        let tables = SceneTables::new(&scene, Accel::build(&scene).unwrap()).unwrap();
        let [now_s, last_s] = [random(), random()];
        let last_s = now_s + (last_s - now_s) * if round % 2 == 0 { 0.1 } else { 0.4 };
        let rig = rig(DVec3::new(random(), random(), random()) * 0.02, DVec3::ZERO);
        let (now, before) = (eyes(&rig, 1.0), eyes(&rig, 0.0));
        let camera =
            Camera { views: now, width: 320, height: 180, centre: glam::Vec2::splat(0.5), ..Default::default() };
        let bound =
            history_rows(None, &camera, &before, &tables, &tables.update(&mut Default::default(), now_s, last_s).1)
                .unwrap();
        let still = history_rows(None, &camera, &before, &tables, &[]).unwrap();
        let [is, was] = [now_s, last_s].map(|time_s| scene.at(time_s));
        let mut most: f64 = 0.0;
        for body in &scene.motion.bodies {
            let corners = |scene: &Scene| -> Vec<DVec3> {
                let Instance { mesh, world_from_local } = scene.instances[body.instance];
                scene.meshes[mesh].positions.iter().map(|p| world_from_local.transform_point3(*p).as_dvec3()).collect()
            };
            for (p, q) in corners(&is).into_iter().zip(corners(&was)) {
                for (eye, last) in [(0, 0), (1, 1), (1, 0)] {
                    let row = |view: &View, p: DVec3| {
                        let v = p - view.origin.as_dvec3();
                        let up = v.dot(view.up.as_dvec3()) / f64::from(view.tan_half_y);
                        let right = v.dot(view.right.as_dvec3()) / f64::from(view.tan_half_x);
                        let z = v.dot(view.forward.as_dvec3());
                        (z > 0.0 && right.abs() < z && up.abs() < z).then_some((0.5 - 0.5 * up / z) * 180.0)
                    };
                    // The previous position may lie outside the image.
                    let Some(seen) = row(&camera.views[eye], p) else { continue };
                    let wide = View { tan_half_x: 1e6, ..before[last] };
                    most = row(&wide, q).map_or(most, |there| most.max((there - seen).abs()));
                }
            }
        }
        let is_capped = bound == 180 / LARGEST_SHARE;
        assert!(is_capped || most <= f64::from(bound), "{round}: {most} rows, bound {bound}");
        bounded += usize::from(!is_capped);
        tight += usize::from(!is_capped && most > f64::from(still));
    }
    assert!(bounded > 10 && tight > 3, "{bounded} of 40 have a bound, {tight} of them need that of the bodies");
}

/// Looks at static points in a mirror that turns and moves.
#[test]
fn mirror_images_move_within_the_row_bound() {
    let mut seed = 7u32;
    let mut random = || {
        seed = seed.wrapping_mul(0x915f_77f5).wrapping_add(0x6d2b_79f5);
        f64::from(seed >> 8) / f64::from(1u32 << 24) - 0.5
    };
    let eye = eyes(&rig(DVec3::ZERO, DVec3::ZERO), 0.0);
    let camera = Camera { views: eye, width: 1280, height: 720, centre: glam::Vec2::splat(0.5), ..Default::default() };
    let row = |p: DVec3| {
        let v = p - eye[0].origin.as_dvec3();
        let up = v.dot(eye[0].up.as_dvec3()) / f64::from(eye[0].tan_half_y);
        (0.5 - 0.5 * up / v.dot(eye[0].forward.as_dvec3())) * 720.0
    };
    let mut bounded = 0;
    for round in 0..20 {
        let mut scene = builtin::find("cornell").unwrap().build();
        scene.materials.push(Material { metallic: 1.0, roughness: 0.0, ..scene.materials[0].clone() });
        let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
        scene.meshes.push(Mesh {
            positions: corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material: scene.materials.len() - 1,
            ..Mesh::default()
        });
        let instance = scene.instances.len();
        scene.instances.push(Instance { mesh: scene.meshes.len() - 1, world_from_local: Affine3A::IDENTITY });
        let rest = Placement::Parts {
            translation: DVec3::new(0.3 * random(), 1.0, 1.0),
            rotation: DQuat::from_rotation_y(random()),
            scale: DVec3::ONE,
        };
        scene.motion.nodes.push(Node { name: "mirror".into(), parent: None, rest });
        let axis = DVec3::new(1.0, random(), random()).normalize();
        let turns = [DQuat::IDENTITY, DQuat::from_axis_angle(axis, 0.06 * random())];
        let Placement::Parts { rotation, translation, .. } = rest else { unreachable!() };
        let turns = turns.map(|turn| (turn * rotation).as_quat().to_array()).concat();
        let by = if round % 2 == 0 { 0.0 } else { 0.03 };
        let places = [translation, translation + by * DVec3::new(random(), random(), random())];
        let places = places.map(|p| p.as_vec3().to_array()).concat();
        let channel = |target, values, width| Channel {
            target,
            keys: Keys::new(vec![0.0, 1.0], values, width, Interpolation::Linear).unwrap(),
        };
        let channels = vec![channel(Target::Rotation(0), turns, 4), channel(Target::Translation(0), places, 3)];
        scene.motion.animations.push(Animation { name: String::new(), channels, duration_s: 1.0 });
        scene.motion.bodies.push(Body { instance, node: 0, skin: None, weights: Vec::new() });
        let tables = SceneTables::new(&scene, Accel::build(&scene).unwrap()).unwrap();
        let moved = tables.update(&mut Default::default(), 0.0, 1.0).1;
        assert!(moved[0].mirrors_turned.is_some());
        let bound = history_rows(None, &camera, &eye, &tables, &moved).unwrap();
        let without: Vec<_> = moved.iter().map(|body| Moved { mirrors_turned: None, ..*body }).collect();
        let less = history_rows(None, &camera, &eye, &tables, &without).unwrap();
        let [now, last] = [0.0, 1.0].map(|time_s| scene.at(time_s).instances[instance].world_from_local.as_daffine3());
        let over = |place: &DAffine3, p: DVec3| {
            let normal = place.matrix3.z_axis;
            p - 2.0 * normal.dot(p - place.translation) * normal
        };
        let mut most: f64 = 0.0;
        for _ in 0..20_000 {
            let far = 20.0 * (0.5 + random());
            let p = DVec3::new(far * random(), 1.0 + far * random(), 1.0 + far);
            let (image, origin) = (over(&now, p), eye[0].origin.as_dvec3());
            let at = now.inverse();
            let (a, b) = (at.transform_point3(origin), at.transform_point3(image));
            let place = a + (b - a) * (a.z / (a.z - b.z));
            if a.z > 0.0 && b.z < 0.0 && place.x.abs() < 0.5 && place.y.abs() < 0.5 {
                most = most.max((row(image) - row(over(&last, p))).abs());
            }
        }
        let is_capped = bound == 720 / LARGEST_SHARE;
        assert!(is_capped || most <= f64::from(bound), "{round}: {most} rows, bound {bound}");
        bounded += usize::from(!is_capped && most > f64::from(less));
    }
    assert!(bounded > 4, "{bounded} of 20 need the mirror's bound");
}

/// Covers visual-polar images, for motion of gaze and eyes.
#[test]
fn no_point_beyond_the_clearance_moves_by_more_rings() {
    let scene = builtin::find("cornell").unwrap().build();
    let tables = SceneTables::new(&scene, Accel::build(&scene).unwrap()).unwrap();
    let screen = Extent::new(160, 90);
    let grid = PolarSpace::Visual.method().grid(screen);
    let row = |view: &View, p: DVec3| {
        let place = PolarSpace::Visual.method().places(*view, screen);
        place(DVec2::ZERO, p - view.origin.as_dvec3()).row
    };
    for (to, gazes) in [
        (DVec3::ZERO, [[0.5, 0.5], [0.5, 0.5]]),
        (DVec3::ZERO, [[0.5, 0.5], [0.52, 0.49]]),
        (DVec3::new(0.03, -0.02, -0.1), [[0.2, 0.9], [0.2, 0.9]]),
        (DVec3::X * 0.05, [[0.2, 0.3], [0.7, 0.4]]),
    ] {
        let rig = rig(to, DVec3::new(0.05, 0.0, 0.0));
        let [last, now] = [0.0, 1.0].map(|t| PolarSpace::Visual.look(gazes[t as usize], eyes(&rig, t)[0], screen));
        let camera = Camera { views: [now; 2], width: grid.width, height: grid.height, ..Default::default() };
        let bound = history_rows(Some(PolarSpace::Visual), &camera, &[last; 2], &tables, &[]).unwrap();
        let clearance = f64::from(tables.clearance(now.origin));
        let mut most: f64 = 0.0;
        for i in 0..20_000 {
            let part = |k: f64| (f64::from(i) * k).fract();
            let view = rig.view(1.0, Eye::LEFT);
            let ray = view.ray_direction(part(0.618) * 160.0, part(0.414) * 90.0, screen);
            let p = view.origin.as_dvec3() + ray * clearance / part(0.732).max(1e-6);
            most = most.max((row(&now, p) - row(&last, p)).abs());
        }
        assert!(most <= f64::from(bound), "{to} {gazes:?}: {most} rings, bound {bound}");
        // Log-polar images have no bound of their own.
        let any = history_rows(Some(PolarSpace::Log(LogPolar::COMPOSITE)), &camera, &[last; 2], &tables, &[]);
        assert_eq!(any, Some(if now == last { STEP_ROWS } else { grid.height }), "{to} {gazes:?}");
    }
}

#[test]
fn eyes_turning_away_have_no_history() {
    let scene = builtin::find("cornell").unwrap().build();
    let tables = SceneTables::new(&scene, Accel::build(&scene).unwrap()).unwrap();
    let camera = |rig: &Rig| Camera { views: eyes(rig, 1.0), width: 160, height: 90, ..Default::default() };
    let still = rig(DVec3::ZERO, DVec3::ZERO);
    assert_eq!(history_rows(None, &camera(&still), &eyes(&still, 0.0), &tables, &[]), Some(4));
    let away = rig(DVec3::ZERO, DVec3::new(0.0, 6.0, 0.0));
    assert_eq!(history_rows(None, &camera(&away), &eyes(&away, 0.0), &tables, &[]), None);
    let back = rig(DVec3::ZERO, DVec3::Z * 9.0);
    assert_eq!(history_rows(None, &camera(&back), &eyes(&back, 0.0), &tables, &[]), None);
}
