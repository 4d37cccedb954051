use super::*;
use crate::scene::Instance;
use crate::scene::rig::Eye;
use crate::scene::{Light, LightKind, Material, Mesh};
use glam::{Affine3A, Vec3, vec3};

/// Returns a closed box. Its front faces point inwards if `is_seen_within`, else outwards.
fn block(centre: Vec3, half: Vec3, is_seen_within: bool) -> Mesh {
    let corner = |i: u32| centre + half * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - half;
    let quads = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let halves = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let triangles = halves.map(|[a, b, c]| if is_seen_within { [a, c, b] } else { [a, b, c] }).collect();
    Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() }
}

fn scene(meshes: Vec<Mesh>, place: Affine3A) -> Scene {
    let instances = (0..meshes.len()).map(|mesh| Instance { mesh, world_from_local: place }).collect();
    Scene { meshes, instances, materials: vec![Material::default()], ..Scene::empty("test") }
}

fn found(scene: &Scene) -> Viewpoint {
    find(scene, &Wanted::default(), &Budget::unlimited())
}

/// Returns a point's position in the left eye's image: -1 to 1 over its height.
fn seen_at(rig: &Rig, point: Vec3) -> [f32; 2] {
    let view = rig.view(0.0, Eye::LEFT);
    let d = point - view.origin;
    let depth = d.dot(view.forward);
    assert!(depth > 0.0, "{point} is behind");
    [view.right, view.up].map(|axis| d.dot(axis) / depth / view.tan_half_yfov)
}

#[test]
fn object_fills_the_picture_at_any_scale_and_place() {
    for (scale, offset) in [(1.0, Vec3::ZERO), (1e-3, Vec3::ONE), (1e5, vec3(0.0, 1e6, 0.0))] {
        let place = Affine3A::from_scale_rotation_translation(Vec3::splat(scale), glam::Quat::IDENTITY, offset);
        let mesh = block(vec3(1.0, 2.0, 3.0), vec3(0.2, 1.0, 0.3), false);
        let corners: Vec<Vec3> = mesh.positions.iter().map(|p| place.transform_point3(*p)).collect();
        let found = found(&scene(vec![mesh], place));
        assert!(found.room.is_none());
        let seen: Vec<[f32; 2]> = corners.iter().map(|p| seen_at(&found.rig, *p)).collect();
        let most = seen.as_flattened().iter().fold(0.0f32, |a, b| a.max(b.abs()));
        assert!((0.65..0.72).contains(&most), "x {scale}: {seen:?}");
        let distance_m = (found.rig.keys[0].position - found.rig.keys[0].target).length();
        assert_eq!(found.rig.baseline_m, f64::min(0.064, distance_m / 30.0), "x {scale}");
    }
}

#[test]
fn lit_room_is_seen_from_inside() {
    let half = vec3(3.0, 1.3, 4.0);
    let things = [vec3(-1.5, -1.0, -2.0), vec3(1.0, -0.9, 1.0), vec3(2.0, -1.1, -3.0)];
    let mut meshes = vec![block(Vec3::ZERO, half, true), block(Vec3::ZERO, half + 0.2, false)];
    meshes.extend(things.map(|at| block(at, Vec3::splat(0.3), false)));
    let mut room = scene(meshes, Affine3A::IDENTITY);
    assert!(found(&room).room.is_none(), "it is dark in there");
    let lamp = LightKind::Point { position: Vec3::ZERO, radius: 0.0 };
    room.lights.push(Light { kind: lamp, strength: Vec3::ONE });
    let found = found(&room);
    assert!(found.room.is_some());
    let eye = found.rig.keys[0].position.as_vec3();
    assert!(eye.abs().cmplt(half).all(), "{eye}");
    assert!(things.iter().all(|at| (eye - at).abs().max_element() > 0.3), "{eye} is in a thing");
}

/// Many exporters write double-sided materials, even for objects that should not be viewed from inside.
#[test]
fn double_sided_shell_is_seen_from_outside() {
    let mut shell = scene(vec![block(Vec3::ZERO, vec3(3.0, 1.3, 4.0), false)], Affine3A::IDENTITY);
    shell.materials[0] = Material { double_sided: true, emissive: Vec3::ONE, ..Material::default() };
    assert!(found(&shell).room.is_none());
}

#[test]
fn degenerate_scenes_get_a_finite_viewpoint() {
    let line = Mesh { positions: vec![Vec3::ZERO, Vec3::X], triangles: vec![[0, 1, 0]], ..Mesh::default() };
    let point = Mesh { positions: vec![Vec3::ONE], triangles: vec![[0, 0, 0]], ..Mesh::default() };
    for meshes in [vec![], vec![line], vec![point]] {
        let view = found(&scene(meshes, Affine3A::IDENTITY)).rig.view(0.0, Eye::LEFT);
        assert!(view.origin.is_finite() && view.forward.is_finite() && view.right.is_finite());
    }
}

/// Returns a closed ball. Its front faces point inwards if `is_seen_within`.
fn ball(centre: Vec3, radius: f32, is_seen_within: bool) -> Mesh {
    const ROWS: u32 = 16;
    const COLUMNS: u32 = 24;
    let point = |i: u32| {
        let (theta, phi) = ((i / COLUMNS) as f32 / ROWS as f32, (i % COLUMNS) as f32 / COLUMNS as f32);
        let ((sin, cos), (x, z)) = ((theta * std::f32::consts::PI).sin_cos(), (phi * std::f32::consts::TAU).sin_cos());
        centre + radius * vec3(sin * x, cos, sin * z)
    };
    let triangles = (0..ROWS * COLUMNS).flat_map(|i| {
        let right = i - i % COLUMNS + (i + 1) % COLUMNS;
        let [below, below_right] = [i, right].map(|i| i + COLUMNS);
        [[i, below, below_right], [i, below_right, right]]
    });
    let triangles = triangles.map(|[a, b, c]| if is_seen_within { [a, c, b] } else { [a, b, c] }).collect();
    Mesh { positions: (0..(ROWS + 1) * COLUMNS).map(point).collect(), triangles, ..Mesh::default() }
}

/// A shader ball has an inner surface, and an array of balls surrounds the space between them: neither is a room.
#[test]
fn scenes_without_a_floor_are_seen_from_outside() {
    let outer = || ball(Vec3::Y * 3.0, 3.0, false);
    let shell = vec![outer(), ball(Vec3::Y * 3.0, 2.9, true), block(Vec3::Y * 2.0, Vec3::splat(0.5), false)];
    let at = |i: u32| vec3((i % 5) as f32, (i / 25) as f32, (i / 5 % 5) as f32);
    let array = (0..125).map(|i| ball(at(i), 0.45, false)).collect();
    for meshes in [shell, array] {
        let scene = scene(meshes, Affine3A::IDENTITY);
        let found = find(&scene, &Wanted { lights_rooms: true, ..Wanted::default() }, &Budget::unlimited());
        let bounds = scene.bounds();
        let eye = found.rig.keys[0].position.as_vec3();
        assert!(found.room.is_none() && (eye.cmplt(bounds.min).any() || eye.cmpgt(bounds.max).any()), "{eye}");
        assert!(eye.y > (bounds.min.y + bounds.max.y) / 2.0, "the viewer is above the middle: {eye}");
    }
}

#[test]
fn room_is_seen_along_its_length() {
    let half = vec3(2.0, 1.3, 6.0);
    let table = block(vec3(0.0, -1.0, 1.0), vec3(0.5, 0.3, 0.5), false);
    let room = scene(vec![block(Vec3::ZERO, half, true), table], Affine3A::IDENTITY);
    let found = find(&room, &Wanted { lights_rooms: true, ..Wanted::default() }, &Budget::unlimited());
    let place = found.room.expect("a room is seen from inside");
    assert!(place.openness < 0.01 && (1.0..4.0).contains(&place.distance), "{place:?}");
    let key = found.rig.keys[0];
    let ahead = (key.target - key.position).normalize().as_vec3();
    assert!(ahead.z.abs() > 0.7, "{ahead}");
    let to_wall = (half.z * ahead.z.signum() - key.position.z as f32) / ahead.z;
    assert!(to_wall > 6.0, "{to_wall} m to the wall");
}

#[test]
fn orbit_sets_direction_and_distance() {
    let cube = scene(vec![block(Vec3::ZERO, Vec3::ONE, false)], Affine3A::IDENTITY);
    let eye = |azimuth_deg, elevation_deg, zoom| {
        let orbit = Some(Orbit { azimuth_deg, elevation_deg, zoom });
        let key = find(&cube, &Wanted { orbit, ..Wanted::default() }, &Budget::unlimited()).rig.keys[0];
        (key.position - key.target).as_vec3()
    };
    assert!(eye(90.0, 0.0, 1.0).normalize().abs_diff_eq(Vec3::X, 1e-3));
    assert!(eye(0.0, 90.0, 1.0).normalize().dot(Vec3::Y) > 0.999);
    let [near, far] = [2.0, 1.0].map(|zoom| eye(0.0, 0.0, zoom).length());
    assert!((1.5..2.0).contains(&(far / near)), "{far} and {near}");
}
