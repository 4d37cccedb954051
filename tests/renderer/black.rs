//! Denoisers keep the mean of light on surfaces that are black in a channel or in a lobe, and before the sky.
//!
//! Light over albedo is unknown there. A filter that takes it for black light darkens the surfaces around.

use crate::common::{Stage, Subject, sampled, still_rig};
use crate::reference::scenes::studio::{dielectric, metal};
use crate::reference::scenes::{add_material, add_texture, append, empty, matte, place, quad};
use diptych::RunConfig;
use diptych::exec::PerView;
use diptych::image::{Extent, Image, RgbImage};
use diptych::quality::{Denoiser, Filter};
use diptych::scene::rig::{Eye, RigKey};
use diptych::scene::{Clearcoat, Environment, Light, LightKind, Material, Mesh, Scene, TextureRef};
use glam::{Affine2, DVec3, Vec2, Vec3, vec3};

const EXTENT: Extent = Extent::new(64, 48);
const FRAMES: u32 = 10;
/// The last frames, of which means are taken.
const COMPARED: u32 = 4;
const FPS: f64 = 20.0;
/// Largest error of a mean, per eye and channel. Paths of single samples differ by up to 0.003 from frame to frame.
const MOST: f64 = 0.01;

/// Edge length of the floor, and tiles along an edge.
const SIZE: f32 = 12.0;
const TILES: usize = 48;

/// A floor that fills the picture under a lamp and a bright sky, whose diffuse and specular reflections differ.
fn lit(mut scene: Scene) -> Subject {
    scene.environment = Environment::Constant(vec3(0.5, 0.6, 0.7));
    // It is far away, since wide filters spread bright spots over the edges of small images.
    let kind = LightKind::Point { position: vec3(4.0, 8.0, -6.0), radius: 1.2 };
    scene.lights.push(Light { kind, strength: vec3(100.0, 90.0, 80.0) });
    let name = scene.name.clone();
    let mut rig = still_rig(vec3(0.0, 1.6, 1.6), vec3(0.0, -1.0, -1.0).normalize(), Vec3::Y, 0.45);
    rig.baseline_m = 0.064;
    Subject::new(&name, scene, rig)
}

/// Returns the subject with a camera that moves by about two pixels a frame.
pub fn moving(mut subject: Subject) -> Subject {
    let start = subject.rig.keys[0];
    let way = DVec3::new(0.5, -0.1, -0.3);
    let end = RigKey { time_s: 1.0, position: start.position + way, target: start.target + way, ..start };
    subject.rig.keys = vec![start, end];
    subject
}

/// Returns a texture of two by two texels, which repeats so many times in a unit of its coordinates.
pub fn tiles(scene: &mut Scene, [a, b]: [[u8; 4]; 2], times: f32) -> TextureRef {
    let tiles = add_texture(scene, Image { extent: Extent::new(2, 2), pixels: vec![a, b, b, a] }, false);
    TextureRef { uv_from_uv: Affine2::from_scale(Vec2::splat(times)), ..tiles }
}

/// Returns a floor of one material with a texture of these two colours.
pub fn textured(name: &str, texels: [[u8; 4]; 2], material: impl FnOnce(TextureRef) -> Material) -> Subject {
    let mut scene = empty(name);
    let texture = tiles(&mut scene, texels, TILES as f32 / 2.0);
    let material = add_material(&mut scene, material(texture));
    let mut floor = quad(vec3(-0.5 * SIZE, 0.0, 0.5 * SIZE), SIZE * Vec3::X, -SIZE * Vec3::Z, material);
    floor.uvs[0] = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    place(&mut scene, floor);
    lit(scene)
}

/// Returns a floor of tiles in two materials.
fn coplanar(name: &str, materials: [Material; 2]) -> Subject {
    let mut scene = empty(name);
    let edge = SIZE / TILES as f32;
    for (parity, material) in materials.into_iter().enumerate() {
        let material = add_material(&mut scene, material);
        let tiles = (0..TILES).flat_map(|z| (0..TILES).map(move |x| (x, z))).filter(|(x, z)| (x + z) % 2 == parity);
        let mut floor = Mesh { material, ..Mesh::default() };
        for (x, z) in tiles {
            let corner = vec3(x as f32 * edge - 0.5 * SIZE, 0.0, 0.5 * SIZE - z as f32 * edge);
            append(&mut floor, quad(corner, edge * Vec3::X, -edge * Vec3::Z, material));
        }
        place(&mut scene, floor);
    }
    lit(scene)
}

pub fn colored(base: Option<TextureRef>, material: Material) -> Material {
    Material { base_color_texture: base, ..material }
}

pub const WHITE: [u8; 4] = [230, 230, 230, 255];
pub const BLACK: [u8; 4] = [0, 0, 0, 255];
pub const RED: [u8; 4] = [230, 0, 0, 255];
const GREEN: [u8; 4] = [0, 230, 0, 255];
/// Green is roughness and blue metalness, of a dielectric and of a metal.
const MASK: [[u8; 4]; 2] = [[0, 255, 0, 255], [0, 255, 255, 255]];

fn settings(subject: &Subject, denoiser: Denoiser, spp: u32) -> RunConfig {
    let mut settings = subject.accumulated(EXTENT.width, EXTENT.height);
    // Without history, more iterations would spread highlights over the edges of these small images.
    let filter = Filter::new(denoiser, if denoiser == Denoiser::ATROUS { 3 } else { 5 });
    (settings.envelope.most.filter, settings.envelope.most.spp) = (Some(filter), spp.into());
    settings
}

pub fn mean(image: &RgbImage) -> DVec3 {
    let sum = image.pixels.iter().map(|pixel| DVec3::from_array(pixel.map(f64::from))).sum::<DVec3>();
    sum / image.pixels.len() as f64
}

/// Returns the mean of both eyes over the last frames.
fn means(subject: &Subject, settings: &RunConfig, frames: std::ops::Range<u32>) -> PerView<DVec3> {
    let mut stage = Stage::alone(subject, settings);
    let mut sum = PerView::both(DVec3::ZERO, DVec3::ZERO);
    for index in frames.clone() {
        let linear = stage.frame_at(f64::from(index) / FPS, index).linear;
        if index + COMPARED >= frames.end {
            for (eye, sum) in sum.with_eyes_mut() {
                *sum += mean(linear.of(eye)) / f64::from(COMPARED);
            }
        }
    }
    sum
}

/// Asserts that denoised frames have the mean of undenoised ones.
fn assert_light_is_kept(subjects: impl IntoIterator<Item = Subject>, denoisers: &[(Denoiser, u32)]) {
    let mut lost = Vec::new();
    for subject in subjects {
        let mut plain = subject.settings(EXTENT.width, EXTENT.height);
        (plain.seed, plain.envelope.most.spp) = (7, 32.into());
        let expected = means(&subject, &plain, FRAMES - COMPARED..FRAMES);
        for &(denoiser, spp) in denoisers {
            let found = means(&subject, &settings(&subject, denoiser, spp), 0..FRAMES);
            // A channel without light must stay without.
            let ratio = |found: DVec3, expected: DVec3| {
                DVec3::select(expected.cmpeq(DVec3::ZERO), DVec3::ONE + found, found / expected)
            };
            let [left, right] = Eye::BOTH.map(|eye| ratio(*found.of(eye), *expected.of(eye)));
            let line = format!("{} {denoiser:?} {spp} spp: {left:.3} left, {right:.3} right", subject.name);
            println!("{line}");
            let is_near = |ratio: DVec3| (ratio - 1.0).abs().cmple(DVec3::splat(MOST)).all();
            if !is_near(left) || !is_near(right) {
                lost.push(line);
            }
        }
    }
    assert!(lost.is_empty(), "denoised means over those without a denoiser:\n{}", lost.join("\n"));
}

const ALL: [(Denoiser, u32); 3] = [(Denoiser::SVGF, 1), (Denoiser::ATROUS, 1), (Denoiser::BMFR, 1)];

fn black_and_white() -> Subject {
    textured("black and white", [BLACK, WHITE], |base| colored(Some(base), matte()))
}

fn red_and_green() -> Subject {
    textured("red and green", [RED, GREEN], |base| colored(Some(base), matte()))
}

/// The two tiles have no lobe in common.
fn metal_mask() -> Subject {
    let worn = Material { base_color: vec3(0.8, 0.6, 0.4).extend(1.0), metallic: 1.0, ..matte() };
    textured("metal mask", MASK, |mask| Material { metallic_roughness_texture: Some(mask), ..worn })
}

#[test]
fn denoisers_keep_light_beside_black_texels() {
    assert_light_is_kept([black_and_white(), red_and_green()], &ALL);
}

#[test]
fn denoisers_keep_light_beside_black_materials() {
    let tiles = [Vec3::ZERO, Vec3::splat(0.8)];
    let rough = coplanar("black and white plastic", tiles.map(|color| dielectric(color, 1.0)));
    let plain = coplanar(
        "black and white materials",
        tiles.map(|color| colored(None, dielectric(color, 1.0))).map(|material| Material { specular: 0.0, ..material }),
    );
    assert_light_is_kept(sampled([rough, plain], 2), &ALL);
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn denoisers_keep_light_while_the_camera_moves() {
    assert_light_is_kept([black_and_white(), metal_mask()].map(moving), &ALL);
}

/// A floor of slats that are narrower than a pixel, with the sky between them.
fn slats() -> Subject {
    const EDGES: [f32; 2] = [0.016, 0.04];
    let mut scene = empty("slats");
    let material = add_material(&mut scene, matte());
    let mut floor = Mesh { material, ..Mesh::default() };
    for i in -40..40 {
        let corner = vec3(i as f32 * EDGES[1], 0.0, 0.5 * SIZE);
        append(&mut floor, quad(corner, EDGES[0] * Vec3::X, -SIZE * Vec3::Z, material));
    }
    place(&mut scene, floor);
    lit(scene)
}

/// Samples hit surfaces beside the centres of pixels that show the sky.
#[test]
fn denoisers_keep_light_before_the_sky() {
    assert_light_is_kept([slats()], &ALL.map(|(denoiser, _)| (denoiser, 4)));
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn denoisers_keep_light_of_several_samples() {
    assert_light_is_kept([black_and_white(), moving(red_and_green())], &ALL.map(|(denoiser, _)| (denoiser, 4)));
}

/// Each lobe is black somewhere: the diffuse one on metal and black texels, facets on the matte material, and a coat
/// beside an uncoated surface.
#[test]
fn denoisers_keep_the_light_of_every_lobe() {
    let rough = textured("rough plastic", [BLACK, WHITE], |base| colored(Some(base), dielectric(Vec3::ONE, 0.9)));
    let gloss = textured("glossy plastic", [BLACK, WHITE], |base| colored(Some(base), dielectric(Vec3::ONE, 0.4)));
    let facets = coplanar("metal beside matte", [metal(vec3(0.9, 0.7, 0.3), 0.5), matte()]);
    let coat = Clearcoat { factor: 1.0, roughness: 0.4, ..Clearcoat::default() };
    let dark = Material { base_color: Vec3::ZERO.extend(1.0), ..matte() };
    let coated = coplanar("coat beside matte", [Material { clearcoat: coat, ..dark }, matte()]);
    assert_light_is_kept(sampled([metal_mask(), rough, gloss, facets, coated], 5), &ALL);
}
