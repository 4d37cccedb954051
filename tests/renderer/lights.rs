//! Selection among many lights keeps the mean at any scale, and small suns cause little noise.

use crate::common::{Stage, Subject, is_thorough};
use crate::pictures::seen;
use crate::reference::ztest::{Estimate, assert_agrees, mean_and_variance};
use crate::reference::{Pinhole, Reference, scenes};
use crate::unbiased::pinhole;
use diptych::frame::Sampler;
use diptych::image::{Extent, RgbImage};
use diptych::scene::{Environment, Light, LightKind, Material, Scene};
use glam::{DVec3, Vec3, vec3};

const WIDTH: u32 = 32;
const HEIGHT: u32 = 24;

/// Estimates from eight renders, in which both eyes have the same view.
fn rendered(subject: &Subject, bounces: u32, spp: u32) -> Estimate {
    let mut settings = subject.settings(WIDTH, HEIGHT);
    settings.envelope.most.bounces = bounces;
    settings.sampler = Sampler::Pcg;
    settings.envelope.most.spp = spp.into();
    let mut stage = Stage::alone(subject, &settings);
    let frames: Vec<_> = (0..4).map(|i| stage.frame(i).linear).flat_map(|eyes| eyes.into_outer()).collect();
    mean_and_variance(&frames)
}

/// Returns a floor and a wall of edge 6 · `scale` with a block, under all kinds of lamps: spheres, points, spots of
/// both, and triangles, some of which face away.
fn many_lamps(scale: f32) -> (Scene, Pinhole) {
    let mut scene = scenes::empty(&format!("many lamps, scale {scale}"));
    let grey = scenes::add_matte(&mut scene, Vec3::splat(0.6));
    let lamp = scenes::add_material(&mut scene, Material { emissive: vec3(1.5, 1.2, 0.9), ..scenes::matte() });
    let both = Material { emissive: vec3(0.6, 0.9, 1.5), double_sided: true, ..scenes::matte() };
    let both = scenes::add_material(&mut scene, both);
    let at = |x: f32, y: f32, z: f32| vec3(x, y, z) * scale;
    scenes::place(&mut scene, scenes::quad(at(-3.0, 0.0, -3.0), at(0.0, 0.0, 6.0), at(6.0, 0.0, 0.0), grey));
    scenes::place(&mut scene, scenes::quad(at(-3.0, 0.0, -3.0), at(6.0, 0.0, 0.0), at(0.0, 3.0, 0.0), grey));
    let block = scenes::add_mesh(&mut scene, scenes::block(grey));
    scenes::instance(&mut scene, block, scenes::scaled_at(0.8 * scale, at(0.3, 0.4, 0.2)));
    for k in 0..15u32 {
        let (column, row) = ((k % 5) as f32, (k / 5) as f32);
        let position = at(column * 1.2 - 2.4, 1.9 - 0.3 * row, row * 1.5 - 1.8);
        let direction = vec3(0.3 - 0.2 * column, -1.0, 0.4 - 0.3 * row).normalize();
        let (cos_inner, cos_outer) = (0.95, 0.6);
        let radius = if k % 4 < 2 { 0.0 } else { 0.15 * scale };
        let kind = match k % 2 {
            0 => LightKind::Point { position, radius },
            _ => LightKind::Spot { position, radius, direction, cos_inner, cos_outer },
        };
        scene.lights.push(Light { kind, strength: vec3(0.5, 0.4, 0.3 + 0.05 * column) * scale * scale });
        let corner = position + at(0.5, 0.15, 0.3);
        let (u, v) = (at(0.25, 0.05 * row, 0.0), at(0.0, 0.1 * (column - 2.0), 0.2));
        let (u, v) = if k % 3 == 0 { (v, u) } else { (u, v) };
        scenes::place(&mut scene, scenes::quad(corner, u, v, if k % 4 == 3 { both } else { lamp }));
    }
    // The camera is below the lamps: their partial coverage of pixels would cause most of the noise.
    let camera = Pinhole::looking_at(at(0.4, 1.0, 4.5), at(0.0, -0.2, 0.5), Vec3::Y, 30.0);
    (scene, camera)
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn many_lamps_of_every_kind_are_unbiased() {
    let (scene, camera) = many_lamps(1.0);
    let subject = seen((scene, camera));
    let camera = pinhole(&subject);
    let reference = Reference::new(&subject.scene);
    for bounces in if is_thorough() { 1..=3 } else { 3..=3 } {
        let expected = reference.render(&camera, Extent::new(WIDTH, HEIGHT), 192, bounces - 1, 1);
        let found = rendered(&subject, bounces, 128);
        let what = format!("{bounces} reflections");
        println!("{what}\n{}", assert_agrees(&what, &expected, &found, 0.03));
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn picture_is_independent_of_scene_scale() {
    let estimate = |scale| rendered(&seen(many_lamps(scale)), 2, 128);
    let one = estimate(1.0);
    for scale in [1e-3, 1e6] {
        assert_agrees(&format!("scale {scale}"), &one, &estimate(scale), 0.03);
    }
}

/// Returns the irradiance of a floor that faces +y, by the midpoint rule over the bilinearly interpolated image.
fn irradiance(image: &RgbImage, steps: usize) -> DVec3 {
    let sky = Environment::Map { image: image.clone().into(), rotation_deg: 0.0 };
    let (columns, rows) = (steps * image.extent.width as usize, steps * image.extent.height as usize);
    let step = std::f64::consts::PI / rows as f64;
    let mut sum = DVec3::ZERO;
    for row in 0..rows / 2 {
        let (sin_theta, cos_theta) = (step * (row as f64 + 0.5)).sin_cos();
        for column in 0..columns {
            let (s, c) = (std::f64::consts::TAU * ((column as f64 + 0.5) / columns as f64 - 0.5)).sin_cos();
            let direction = DVec3::new(sin_theta * s, cos_theta, -sin_theta * c);
            sum += crate::reference::environment::radiance(&sky, direction) * (sin_theta * cos_theta);
        }
    }
    sum * step * (std::f64::consts::TAU / columns as f64)
}

#[test]
fn one_texel_sun_has_little_noise_and_correct_power() {
    let mut image = RgbImage::filled(Extent::new(256, 128), [0.02; 3]);
    image.pixels[30 * 256 + 100] = [3e5; 3];
    let expected = irradiance(&image, 8).x * 0.5 / std::f64::consts::PI;
    let mut scene = scenes::empty("small sun");
    let grey = scenes::add_matte(&mut scene, Vec3::splat(0.5));
    scenes::place(&mut scene, scenes::quad(vec3(-50.0, 0.0, -50.0), 100.0 * Vec3::Z, 100.0 * Vec3::X, grey));
    scene.environment = Environment::Map { image: image.into(), rotation_deg: 0.0 };
    let camera = Pinhole::looking_at(vec3(0.0, 5.0, 0.1), Vec3::ZERO, Vec3::Z, 45.0);
    let subject = seen((scene, camera));
    let mut settings = subject.settings(WIDTH, HEIGHT);
    settings.envelope.most.bounces = 1;
    settings.sampler = Sampler::Pcg;
    settings.envelope.most.spp = 16.into();
    let image = Stage::alone(&subject, &settings).frame(0).linear.into_left();
    let values: Vec<f64> = image.pixels.iter().map(|p| f64::from(p[0])).collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let rmse = (values.iter().map(|v| (v - expected).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
    println!("mean {mean}, expected {expected}, relative RMSE {}", rmse / expected);
    assert!((mean / expected - 1.0).abs() < 2e-3, "mean {mean}, expected {expected}");
    assert!(rmse < 0.03 * expected, "relative RMSE {}", rmse / expected);
}
