//! A white furnace neither gains nor loses light.

use crate::common::{Stage, Subject, is_thorough, sampled};
use crate::pictures::{brightest, seen};
use crate::reference::scenes::studio::{CLEAR, glass};
use crate::reference::scenes::{add_material, empty, icosphere, matte, place, place_at, quad, scaled_at};
use crate::reference::ztest::{assert_agrees, mean_and_variance};
use crate::reference::{Pinhole, Reference};
use diptych::RunConfig;
use diptych::frame::Sampler;
use diptych::image::{Extent, Image, RgbImage};
use diptych::passes::Aov;
use diptych::scene::{Clearcoat, DiffuseTransmission, Environment, Material, Scene};
use glam::{Vec3, vec3};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 90;

/// Tolerance for the rounding of a sum of samples that are all 1.
const ROUNDING: f32 = 1e-5;

/// Returns the left image and its albedo.
fn render(subject: &Subject, settings: &RunConfig) -> (RgbImage, Vec<f32>) {
    let mut settings = settings.clone();
    settings.buffers.aovs = vec![Aov::Albedo];
    let mut stage = Stage::alone(subject, &settings);
    let image = stage.frame(0).linear.into_left();
    (image, stage.aov(0).into_left().swap_remove(0))
}

/// Returns the pixels whose centre is on a surface of that albedo.
fn pixels_of(albedo: &[f32], of: f32) -> Vec<usize> {
    (0..albedo.len()).filter(|&i| (albedo[i] - of).abs() < 1e-6).collect()
}

/// Returns the pixels of the set whose neighbours are all in it, too.
fn inner(pixels: &[usize], width: usize) -> Vec<usize> {
    let is_in = |i: usize| pixels.binary_search(&i).is_ok();
    let block = |i: usize| (0..3).flat_map(move |dy| (0..3).map(move |dx| i + dy * width + dx - width - 1));
    pixels.iter().copied().filter(|&i| i > width && block(i).all(is_in)).collect()
}

fn mean(image: &RgbImage, pixels: &[usize]) -> f64 {
    pixels.iter().map(|&i| f64::from(image.pixels[i][1])).sum::<f64>() / pixels.len() as f64
}

#[test]
fn spheres_in_a_white_furnace_show_their_albedo() {
    let subject = Subject::load("builtin:furnace");
    for (spp, bounces, sampler) in [(1, 6, Sampler::Sobol), (1, 1, Sampler::Pcg), (16, 12, Sampler::Pcg)] {
        let mut settings = subject.settings(WIDTH, HEIGHT);
        settings.envelope.most.bounces = bounces;
        settings.envelope.most.spp = spp.into();
        settings.sampler = sampler;
        let (image, albedo) = render(&subject, &settings);
        let brightest = brightest(&image);
        assert!(brightest <= 1.0 + ROUNDING, "{spp} spp: light is made: {brightest}");
        for (of, least) in [(1.0, 500), (0.5, 40), (0.2, 40)] {
            let pixels = inner(&pixels_of(&albedo, of), WIDTH as usize);
            assert!(pixels.len() >= least, "{} pixels of albedo {of}", pixels.len());
            // Only paths that hit another sphere lose light, because some are cut off there. With one sample these are
            // about one path in fifty, and 98 grey pixels vary by four standard deviations of 1.4.
            let (exact_share, least_mean) = match (spp, bounces) {
                (_, 1) => (0.9, 0.94),
                (1, _) => (0.92, 0.98),
                _ => (0.8, 0.995),
            };
            let exact = pixels.iter().filter(|i| (image.pixels[**i][1] - of).abs() <= ROUNDING).count();
            assert!(exact as f64 >= exact_share * pixels.len() as f64, "{exact} of {} show {of}", pixels.len());
            let mean = mean(&image, &pixels) / f64::from(of);
            assert!((least_mean..=1.0 + 1e-5).contains(&mean), "{spp} spp: albedo {of} shows {mean} of it");
        }
        let sky = pixels_of(&albedo, 0.0);
        assert!(sky.iter().any(|&i| image.pixels[i] == [1.0; 3]));
    }
}

#[test]
fn denoiser_keeps_the_mean() {
    let subject = Subject::load("builtin:furnace");
    let raw = render(&subject, &subject.settings(WIDTH, HEIGHT));
    let filtered = render(&subject, &subject.denoised(WIDTH, HEIGHT));
    for of in [1.0, 0.5, 0.2] {
        let pixels = pixels_of(&raw.1, of);
        let ratio = mean(&filtered.0, &pixels) / mean(&raw.0, &pixels);
        assert!((ratio - 1.0).abs() < 0.01, "albedo {of}: {ratio}");
    }
    let brightest = brightest(&filtered.0);
    assert!(brightest <= 1.0 + ROUNDING, "light is made: {brightest}");
}

/// Returns white dielectrics, metals, thin glass and coats, each with four roughnesses.
fn white_materials() -> Vec<Material> {
    let dielectric = Material { specular: 1.0, ..matte() };
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let kinds = [
        dielectric.clone(),
        Material { ior: 2.5, ..dielectric.clone() },
        Material { metallic: 1.0, ..dielectric.clone() },
        Material { transmission: 1.0, ..dielectric.clone() },
        Material { transmission: 0.5, metallic: 0.5, ..dielectric.clone() },
        Material { clearcoat: coat, ..dielectric },
    ];
    let rough = |roughness: f32| kinds.clone().map(|kind| Material { roughness, ..kind });
    let mut all = [0.0, 0.25, 0.5, 1.0].map(rough).concat();
    for material in &mut all {
        material.clearcoat.roughness = 1.0 - material.roughness;
    }
    all
}

/// Returns white solids that transmit next to nothing, of six indices of refraction, each with four roughnesses.
fn white_solids() -> Vec<Material> {
    let solid = |ior| Material { ior, specular: 1.0, transmission: 1e-3, volume: CLEAR, ..matte() };
    let kinds = [1.1, 1.33, 1.5, 1.8, 2.2, 2.5].map(solid);
    let rough = |roughness: f32| kinds.clone().map(|kind| Material { roughness, ..kind });
    [0.1, 0.25, 0.5, 1.0].map(rough).concat()
}

/// Returns six by four tiles in the plane y = 0 in front of a sky of 1, seen from an elevation of `elevation_deg` over
/// the plane, or from behind if it is negative. Every path ends after one scattering.
fn tiles(materials: Vec<Material>, elevation_deg: f32) -> (Scene, Pinhole) {
    let mut scene = empty(&format!("tiles from {elevation_deg} degrees"));
    scene.environment = Environment::Constant(Vec3::ONE);
    let (sin, cos) = elevation_deg.to_radians().sin_cos();
    // Tiles are stretched against foreshortening, so that each is square in the picture.
    let depth = 1.0 / sin.abs();
    for (i, material) in materials.into_iter().enumerate() {
        let material = add_material(&mut scene, material);
        let corner = vec3((i % 6) as f32 - 3.0, 0.0, ((i / 6) as f32 - 2.0) * depth);
        place(&mut scene, quad(corner, depth * Vec3::Z, Vec3::X, material));
    }
    let camera = Pinhole::looking_at(vec3(0.0, 100.0 * sin, 100.0 * cos), Vec3::ZERO, Vec3::Y, 2.29);
    (scene, camera)
}

/// Returns balls of three roughnesses with flat facets, because refraction with smooth normals does not conserve energy.
fn balls(name: &str, of_roughness: impl Fn(f32) -> Material) -> (Scene, Pinhole) {
    let mut scene = empty(name);
    scene.environment = Environment::Constant(Vec3::ONE);
    for (i, roughness) in [0.0, 0.3, 0.7].into_iter().enumerate() {
        let material = add_material(&mut scene, Material { volume: CLEAR, ..of_roughness(roughness) });
        place_at(&mut scene, icosphere(2, false, material), scaled_at(0.48, vec3(i as f32 - 1.0, 0.0, 0.0)));
    }
    (scene, Pinhole::looking_at(Vec3::Z * 50.0, Vec3::ZERO, Vec3::Y, 1.6))
}

/// Asserts that no block of 8x8 pixels is brighter than the sky, and that each loses as much light as the reference
/// says.
fn hold_in_the_furnace((scene, camera): (Scene, Pinhole), bounces: u32) {
    let extent = Extent::new(48, 32);
    let subject = seen((scene, camera));
    let mut settings = subject.settings(extent.width, extent.height);
    (settings.envelope.most.bounces, settings.envelope.most.spp, settings.sampler) = (bounces, 64.into(), Sampler::Pcg);
    let mut stage = Stage::alone(&subject, &settings);
    let renders: Vec<_> = (0..4).map(|i| stage.frame(i).linear).flat_map(|eyes| eyes.into_outer()).collect();
    let found = mean_and_variance(&renders);
    let expected =
        Reference::new(&subject.scene).render(&camera, extent, if is_thorough() { 1024 } else { 512 }, bounces - 1, 5);
    let report = assert_agrees(&subject.name, &expected, &found, 0.02);
    println!("{}\n{report}", subject.name);
    let sky = mean_and_variance(&[Image::filled(extent, [1.0; 3]), Image::filled(extent, [1.0; 3])]);
    let over_sky = crate::reference::ztest::compare(&sky, &found);
    let brightest = over_sky.block_z.as_flattened().iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    assert!(brightest < 4.5, "{}: a block is brighter than the sky, z = {brightest}", subject.name);
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn white_materials_gain_no_energy_in_a_furnace() {
    for elevation_deg in [25.0, 6.0, 70.0] {
        hold_in_the_furnace(tiles(white_materials(), elevation_deg), 1);
    }
}

/// What the base scatters and what is reflected totally must not be more than what arrives.
#[test]
fn white_solids_gain_no_energy_from_inside() {
    for elevation_deg in sampled([-25.0, -6.0, -70.0], 3) {
        hold_in_the_furnace(tiles(white_solids(), elevation_deg), 1);
    }
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn white_glass_gains_no_energy_in_a_furnace() {
    hold_in_the_furnace(balls("glass balls", |roughness| glass(Vec3::ONE, roughness)), 16);
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn white_lampshades_gain_no_energy_in_a_furnace() {
    let through = DiffuseTransmission { factor: 0.8, color: Vec3::ONE, ..DiffuseTransmission::default() };
    let shade = |roughness| Material { diffuse_transmission: through, specular: 1.0, roughness, ..matte() };
    hold_in_the_furnace(balls("lampshades", shade), 16);
}
