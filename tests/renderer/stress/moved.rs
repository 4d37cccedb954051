//! A scene looks the same at every scale and position.

use diptych::frame::Sampler;
use diptych::image::RgbImage;
use diptych::scene::{Environment, Light, LightKind, Material, Scene};
use glam::{Affine3A, Vec3, vec3, vec4};

use super::{Effort, image, renders, subject};
use crate::reference::Pinhole;
use crate::reference::scenes::{add_material, add_matte, add_mesh, block, empty, instance, matte, place, quad};
use crate::reference::ztest::{assert_agrees, mean_and_variance};

/// Returns a room of 4 x 4 x 4 with all kinds of light and shadow, on a lattice of 1/4.
fn room(scale: f32, offset: Vec3) -> (Scene, Pinhole) {
    let mut scene = empty("room");
    let grey = add_matte(&mut scene, Vec3::splat(0.5));
    let red = add_matte(&mut scene, vec3(0.75, 0.25, 0.25));
    let glow = Material { base_color: vec4(0.25, 0.25, 0.25, 1.0), emissive: vec3(4.0, 3.0, 2.0), ..matte() };
    let lamp = add_material(&mut scene, glow);
    let (x, y, z) = (4.0 * Vec3::X, 4.0 * Vec3::Y, 4.0 * Vec3::Z);
    let corner = vec3(-2.0, 0.0, -2.0);
    place(&mut scene, quad(corner, z, x, grey));
    place(&mut scene, quad(corner, x, y, grey));
    place(&mut scene, quad(corner, y, z, red));
    place(&mut scene, quad(vec3(-1.0, 3.5, -1.0), Vec3::X, Vec3::Z, lamp));
    place(&mut scene, quad(vec3(1.0, 0.25, -1.75), Vec3::X, Vec3::Y, lamp));
    let cube = add_mesh(&mut scene, block(grey));
    instance(&mut scene, cube, Affine3A::from_translation(vec3(-0.5, 0.5, 0.0)));
    instance(
        &mut scene,
        cube,
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.5), glam::Quat::IDENTITY, vec3(0.75, 0.25, 0.5)),
    );
    let square = scale * scale;
    let at = |p: Vec3| p * scale + offset;
    let local = |position, radius, strength: f32| Light {
        kind: LightKind::Point { position: at(position), radius: radius * scale },
        strength: Vec3::splat(strength * square),
    };
    let sun = LightKind::Directional { direction: vec3(-1.0, -2.0, -1.0).normalize(), angle_rad: 0.02 };
    scene.lights = vec![
        local(vec3(1.25, 1.25, 0.0), 0.25, 1.0),
        local(vec3(0.5, 1.5, 1.0), 0.0, 0.5),
        Light { kind: sun, strength: Vec3::splat(0.5) },
    ];
    scene.environment = Environment::Constant(Vec3::splat(0.125));
    for place in &mut scene.instances {
        let world = Affine3A::from_translation(offset) * Affine3A::from_scale(Vec3::splat(scale));
        place.world_from_local = world * place.world_from_local;
    }
    let camera = Pinhole::looking_at(vec3(0.5, 1.5, 5.0), vec3(0.0, 1.0, 0.0), Vec3::Y, 45.0);
    (scene, Pinhole { origin: at(camera.origin), ..camera })
}

fn many(scale: f32, offset: Vec3) -> Vec<RgbImage> {
    let effort = Effort { seed: 9 + offset.x.to_bits() % 1000, ..Effort::new(96, 3) };
    renders(&subject(&format!("room x {scale} at {offset}"), room(scale, offset)), effort, Sampler::Pcg, 4)
}

/// Halving is exact, and so is everything that follows: no bit of the image depends on the unit of length.
#[test]
fn same_bytes_when_scaled_by_a_power_of_two() {
    let render = |scale| image("room", room(scale, Vec3::ZERO), Effort::new(64, 6));
    let right = render(1.0);
    for scale in [1.0 / 1024.0, 1024.0 * 1024.0] {
        let found = render(scale);
        let unlike = found.pixels.iter().zip(&right.pixels).filter(|(a, b)| a != b).count();
        assert_eq!(unlike, 0, "x {scale}: pixels differ");
    }
}

#[test]
fn scene_scale_changes_only_noise() {
    let right = mean_and_variance(&many(1.0, Vec3::ZERO));
    for scale in [1e-3, 1e6] {
        assert_agrees(&format!("x {scale}"), &right, &mean_and_variance(&many(scale, Vec3::ZERO)), 0.02);
    }
}

#[test]
fn scene_position_changes_only_noise() {
    let right = mean_and_variance(&many(1.0, Vec3::ZERO));
    for (scale, offset) in [
        (1.0, vec3(4e2, -4e2, 8e2)),
        (1.0, vec3(4e4, -8e4, 4e4)),
        (1.0, vec3(4e5, -2e5, 4e5)),
        (1e6, vec3(4e8, 0.0, -4e8)),
    ] {
        let found = mean_and_variance(&many(scale, offset));
        println!("{}", assert_agrees(&format!("x {scale} at {offset}"), &right, &found, 0.02));
    }
}
