//! Surfaces: normals, mirrored and stretched instances.

use std::f64::consts::PI;

use diptych::scene::{Environment, Light, LightKind, Material, Scene};
use glam::{Affine3A, DVec3, Vec3, vec3, vec4};

use crate::reference::Reference;
use crate::reference::asserts::{assert_exact, assert_near};
use crate::reference::scenes::{add_material, add_matte, add_mesh, empty, icosphere, instance, matte, place, quad};

#[test]
fn shading_normals_turn_the_cosine_without_leaks() {
    let mut scene = empty("tilted");
    let white = add_matte(&mut scene, Vec3::ONE);
    let mut mesh = quad(vec3(-1.0, 0.0, -1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, white);
    let normal = vec3(0.6, 0.8, 0.0);
    mesh.normals = vec![normal; 4];
    place(&mut scene, mesh);
    let sun = |scene: &Scene, direction: Vec3, from: Vec3| {
        let mut scene = scene.clone();
        let kind = LightKind::Directional { direction, angle_rad: 0.0 };
        scene.lights.push(Light { kind, strength: Vec3::splat(PI as f32) });
        Reference::new(&scene).probe(from, -from, 2, 0, 1)
    };
    assert_exact(&sun(&scene, Vec3::NEG_Y, Vec3::Y), [0.8; 3]);
    assert_exact(&sun(&scene, Vec3::Y, Vec3::NEG_Y), [0.8; 3]);
    assert_exact(&sun(&scene, -normal, Vec3::Y), [1.0; 3]);
    assert_exact(&sun(&scene, Vec3::NEG_Y, Vec3::NEG_Y), [0.0; 3]);
    // The light is above the shading normal's horizon, but below the surface.
    assert_exact(&sun(&scene, vec3(-0.96, 0.28, 0.0), Vec3::Y), [0.0; 3]);
    // The shading normal faces away from this viewer, so the geometric one is used.
    assert_exact(&sun(&scene, Vec3::NEG_Y, vec3(-0.96, 0.28, 0.0)), [1.0; 3]);
}

#[test]
fn bounces_below_the_surface_are_lost() {
    let mut scene = empty("tilted furnace");
    let white = add_matte(&mut scene, Vec3::ONE);
    let mut mesh = quad(vec3(-1.0, 0.0, -1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, white);
    mesh.normals = vec![vec3(0.6, 0.8, 0.0); 4];
    place(&mut scene, mesh);
    scene.environment = Environment::Constant(Vec3::ONE);
    let seen = Reference::new(&scene).probe(Vec3::Y, Vec3::NEG_Y, 200_000, 0, 6);
    // A fraction (1 + cos) / 2 of the cosine lobe around ns lies above a plane tilted by that angle.
    assert_near(&seen, 0.9, 0.002);
}

#[test]
fn mirrored_instance_keeps_its_front() {
    let mut scene = empty("mirror");
    let lamp = Material { emissive: Vec3::ONE, base_color: vec4(0.0, 0.0, 0.0, 1.0), ..matte() };
    let lamp = add_material(&mut scene, lamp);
    let mut mesh = quad(vec3(1.0, -1.0, -1.0), 2.0 * Vec3::Y, 2.0 * Vec3::Z, lamp); // faces +x
    mesh.normals = vec![Vec3::X; 4];
    let mesh = add_mesh(&mut scene, mesh);
    let seen_from = |scale: Vec3, x: f32| {
        let mut scene = scene.clone();
        instance(&mut scene, mesh, Affine3A::from_scale(scale));
        Reference::new(&scene).probe(vec3(x, 0.1, 0.3), vec3(-x, 0.0, 0.0), 2, 0, 1)
    };
    assert_exact(&seen_from(Vec3::ONE, 3.0), [1.0; 3]);
    assert_exact(&seen_from(Vec3::ONE, -3.0), [0.0; 3]);
    // Mirrored in x, the lamp is at −1 and faces −x. Mirrored in y, it stays in place and faces +x.
    assert_exact(&seen_from(vec3(-1.0, 1.0, 1.0), -3.0), [1.0; 3]);
    assert_exact(&seen_from(vec3(-1.0, 1.0, 1.0), 3.0), [0.0; 3]);
    assert_exact(&seen_from(vec3(1.0, -2.0, 1.0), 3.0), [1.0; 3]);
    assert_exact(&seen_from(vec3(1.0, -2.0, 1.0), -3.0), [0.0; 3]);
}

/// Normals transform by the inverse transpose: the normal of an ellipsoid is its gradient.
#[test]
fn smooth_normals_follow_the_inverse_transpose() {
    for mirror in [1.0f32, -1.0] {
        let mut scene = empty("ellipsoid");
        let white = add_matte(&mut scene, Vec3::ONE);
        let ball = add_mesh(&mut scene, icosphere(5, true, white));
        let stretch = vec3(mirror * 3.0, 1.0, 1.0);
        instance(&mut scene, ball, Affine3A::from_scale(stretch));
        let kind = LightKind::Directional { direction: Vec3::NEG_Y, angle_rad: 0.0 };
        scene.lights.push(Light { kind, strength: Vec3::splat(PI as f32) });
        let x = 1.5f32;
        let seen = Reference::new(&scene).probe(vec3(x, 5.0, 0.0), Vec3::NEG_Y, 2, 0, 1);
        let height = (1.0f64 - 0.25).sqrt();
        let normal = DVec3::new(1.5 / 9.0, height, 0.0).normalize();
        assert!((seen.mean[0][0] - normal.y).abs() < 1e-3, "{seen:?} {normal}");
    }
}
