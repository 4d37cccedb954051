//! Environment and camera.

use diptych::image::{Extent, Image};
use diptych::scene::{Environment, Material};
use glam::{DVec3, Vec3, vec3};

use super::{look_at_floor, white_floor};
use crate::reference::asserts::assert_near;
use crate::reference::scenes::matte::box_area_light;
use crate::reference::scenes::{add_material, add_quad, colored, empty, matte, place, quad};
use crate::reference::{Pinhole, Reference, environment};

#[test]
fn sky_runs_from_negative_z_right_to_positive_x() {
    let mut image = Image::filled(Extent::new(4, 2), [0.0f32; 3]);
    for (i, texel) in image.pixels.iter_mut().enumerate() {
        *texel = [i as f32 % 4.0, (i / 4) as f32, 1.0];
    }
    let sky = |rotation_deg| Environment::Map { image: image.clone().into(), rotation_deg };
    let at = |rotation: f32, azimuth_deg: f64, y: f64| {
        let a = azimuth_deg.to_radians();
        let d = DVec3::new(a.sin(), y, -a.cos()).normalize();
        environment::radiance(&sky(rotation), d).to_array()
    };
    let close = |a: [f64; 3], b: [f64; 3]| {
        assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-9), "{a:?} is not {b:?}");
    };
    close(at(0.0, 0.0, 0.0), [1.5, 0.5, 1.0]); // the image's centre, between texels
    close(at(0.0, 45.0, 0.0), [2.0, 0.5, 1.0]);
    close(at(0.0, 90.0, 0.0), [2.5, 0.5, 1.0]);
    close(at(0.0, 180.0, 0.0), [1.5, 0.5, 1.0]); // 3 and 0 across the seam
    close(at(90.0, -45.0, 0.0), [2.0, 0.5, 1.0]);
    close(at(0.0, 45.0, 1.0), [2.0, 0.0, 1.0]); // 45° up is the upper row's centre
    close(at(0.0, 45.0, 5.0), [2.0, 0.0, 1.0]); // clamped above it
    close(at(0.0, 45.0, -5.0), [2.0, 1.0, 1.0]);
}

/// A sky of radiance 2 above and 0 below, seen by a floor and by a wall.
#[test]
fn half_sky_lights_floors_fully_and_walls_by_half() {
    let mut image = Image::filled(Extent::new(4, 512), [0.0f32; 3]);
    image.pixels[..4 * 256].fill([2.0; 3]);
    let environment = Environment::Map { image: image.into(), rotation_deg: 0.0 };
    let mut scene = white_floor("half sky");
    scene.environment = environment.clone();
    assert_near(&look_at_floor(&scene, 0.0, 0.0, 100_000, 0), 2.0, 0.001);
    let mut scene = empty("half sky");
    add_quad(&mut scene, (vec3(-1.0, -1.0, 0.0), 2.0 * Vec3::X, 2.0 * Vec3::Y), colored(Vec3::ONE));
    scene.environment = environment;
    let seen = Reference::new(&scene).probe(Vec3::Z, Vec3::NEG_Z, 200_000, 0, 9);
    assert_near(&seen, 1.0, 0.003);
}

#[test]
fn pixels_run_right_and_down_and_are_box_filtered() {
    let mut scene = empty("camera");
    let extent = Extent::new(8, 4);
    let camera = Pinhole::looking_at(Vec3::ZERO, Vec3::X, Vec3::Z, 90.0);
    // The image plane at distance 1 is 2 high and 4 wide; right is −y, up is +z.
    assert_eq!(camera.right, Vec3::NEG_Y);
    let lamp = add_material(&mut scene, Material { emissive: Vec3::ONE, double_sided: true, ..matte() });
    // Covers x from 5 to 6.5 and y from 0 to 1 of the image.
    let corner = vec3(1.0, 2.0 - 6.5 / 2.0, 0.5);
    place(&mut scene, quad(corner, 0.75 * Vec3::Y, 0.5 * Vec3::Z, lamp));
    let seen = Reference::new(&scene).render(&camera, extent, 4_000, 0, 1);
    for y in 0..4 {
        for x in 0..8 {
            let expected = match (x, y) {
                (5, 0) => 1.0,
                (6, 0) => 0.5,
                _ => 0.0,
            };
            let i = y * 8 + x;
            let sigma = seen.variance_of_mean[i][0].sqrt();
            assert!((seen.mean[i][0] - expected).abs() <= 4.5 * sigma + 1e-9, "{x}, {y}: {seen:?}");
        }
    }
}

#[test]
fn render_depends_only_on_its_seed() {
    let (scene, camera) = box_area_light();
    let reference = Reference::new(&scene);
    let render = |seed| reference.render(&camera, Extent::new(12, 9), 4, 2, seed).mean;
    assert_eq!(render(1), render(1));
    assert_ne!(render(1), render(2));
}
