//! Base colour textures are averaged over the pixels of denoised frames of one sample per pixel.

use crate::common::{Stage, Subject, still_rig};
use crate::reference::scenes::studio::{Pictures, dielectric};
use crate::reference::scenes::{add_material, add_texture, empty, matte, place, quad};
use diptych::RunConfig;
use diptych::image::{Extent, Image, RgbImage};
use diptych::metrics;
use diptych::passes::Aov;
use diptych::quality::{Denoiser, Filter};
use diptych::scene::{AlphaMode, Environment, Material, Mesh, Scene, TextureRef};
use glam::{Affine2, Vec2, Vec3, vec3};

const EXTENT: Extent = Extent::new(64, 48);

/// Returns the scene seen along a floor, in light from all sides, which has no noise.
fn subject(name: &str, mut scene: Scene) -> Subject {
    scene.environment = Environment::Constant(Vec3::ONE);
    let mut rig = still_rig(vec3(0.0, 1.0, 2.0), vec3(0.0, -0.3, -1.0).normalize(), Vec3::Y, 0.5);
    rig.baseline_m = 0.064;
    Subject::new(name, scene, rig)
}

/// Returns a wide floor at a height, whose texture coordinates go from 0 to 1.
fn ground(height: f32, material: usize) -> Mesh {
    let mut mesh = quad(vec3(-20.0, height, 2.0), 40.0 * Vec3::X, -40.0 * Vec3::Z, material);
    mesh.uvs[0] = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    mesh
}

/// Returns a floor with many small tiles of a material with the checker as base colour.
pub fn floor(name: &str, change: fn(&mut Material)) -> Subject {
    let mut scene = empty(name);
    let checker = Pictures::add(&mut scene).checker;
    let tiles = TextureRef { uv_from_uv: Affine2::from_scale(Vec2::splat(12.0)), ..checker };
    let mut material = Material { base_color_texture: Some(tiles), ..matte() };
    change(&mut material);
    let material = add_material(&mut scene, material);
    place(&mut scene, ground(0.0, material));
    subject(name, scene)
}

fn settings(subject: &Subject, denoiser: Denoiser, filter_textures: bool) -> RunConfig {
    let mut settings = RunConfig { filter_textures, ..subject.accumulated(EXTENT.width, EXTENT.height) };
    settings.envelope.most.filter = Some(Filter::new(denoiser, 5));
    settings
}

fn reference(subject: &Subject) -> RgbImage {
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.envelope.most.spp = 64.into();
    Stage::alone(subject, &settings).frame(0).linear.into_left()
}

#[test]
fn distant_textures_are_averaged_over_pixels() {
    let matte = floor("matte", |_| ());
    let glossy =
        floor("glossy", |m| *m = Material { base_color_texture: m.base_color_texture, ..dielectric(Vec3::ONE, 0.4) });
    let metal = floor("metal", |m| (m.metallic, m.roughness, m.specular) = (1.0, 0.5, 1.0));
    let unlit = floor("unlit", |m| m.unlit = true);
    for subject in [matte, glossy, metal, unlit] {
        let expected = reference(&subject);
        for denoiser in [Denoiser::SVGF, Denoiser::ATROUS] {
            let [filtered, sampled] = [true, false].map(|filter| {
                let frame = Stage::alone(&subject, &settings(&subject, denoiser, filter)).frame(0);
                metrics::compare(&expected, frame.linear.left()).unwrap()
            });
            let what =
                format!("{}, {denoiser:?}: PSNR {:.2}, unfiltered {:.2} dB", subject.name, filtered.psnr, sampled.psnr);
            let mean_ratio = filtered.mean_ratio.expect("the reference has light");
            println!("{what}, mean {mean_ratio:.4}");
            assert!(filtered.psnr > sampled.psnr + 3.0, "{what}");
            assert!((mean_ratio - 1.0).abs() < 0.02, "{what}: mean {mean_ratio}");
        }
    }
}

/// A dark polished floor reflects a tiled ceiling.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn distant_textures_in_polish_are_filtered() {
    let mut scene = empty("polish");
    let checker = Pictures::add(&mut scene).checker;
    let tiles = TextureRef { uv_from_uv: Affine2::from_scale(Vec2::splat(40.0)), ..checker };
    let ceiling = Material { base_color_texture: Some(tiles), unlit: true, ..matte() };
    let ceiling = add_material(&mut scene, ceiling);
    place(&mut scene, ground(3.0, ceiling));
    let polish = add_material(&mut scene, Material { ior: 2.4, ..dielectric(Vec3::splat(0.02), 0.0) });
    place(&mut scene, ground(0.0, polish));
    let subject = subject("polish", scene);
    let lower = |image: &RgbImage| {
        let extent = Extent::new(EXTENT.width, EXTENT.height / 3);
        Image { extent, pixels: image.pixels[image.pixels.len() - extent.area()..].to_vec() }
    };
    let expected = lower(&reference(&subject));
    let [filtered, sampled] = [true, false].map(|filter| {
        let frame = Stage::alone(&subject, &settings(&subject, Denoiser::SVGF, filter)).frame(0);
        metrics::compare(&expected, &lower(frame.linear.left())).unwrap()
    });
    let mean_ratio = filtered.mean_ratio.expect("the reference has light");
    println!("PSNR {:.2}, unfiltered {:.2} dB, mean {mean_ratio:.4}", filtered.psnr, sampled.psnr);
    assert!(filtered.psnr > sampled.psnr + 3.0, "PSNR {:.2}, unfiltered {:.2} dB", filtered.psnr, sampled.psnr);
    assert!((mean_ratio - 1.0).abs() < 0.02, "mean {mean_ratio}");
}

/// The clear texels between the leaves have a colour, which no pixel may show.
#[test]
fn transparent_texels_do_not_bleed_colour() {
    let mut scene = empty("leaves");
    let mut leaves = Image::filled(Extent::new(8, 8), [200, 0, 0, 255]);
    leaves.pixels.iter_mut().step_by(2).for_each(|texel| *texel = [0, 255, 0, 0]);
    let uv_from_uv = Affine2::from_scale(Vec2::splat(30.0));
    let texture = TextureRef { uv_from_uv, ..add_texture(&mut scene, leaves, false) };
    for alpha_mode in [AlphaMode::Mask { cutoff: 0.5 }, AlphaMode::Blend] {
        let mut scene = scene.clone();
        let leaf = Material { base_color_texture: Some(texture), alpha_mode, ..matte() };
        let leaf = add_material(&mut scene, leaf);
        place(&mut scene, ground(0.0, leaf));
        let black = add_material(&mut scene, Material { base_color: Vec3::ZERO.extend(1.0), ..matte() });
        place(&mut scene, ground(-0.1, black));
        let subject = subject("leaves", scene);
        let frame = Stage::alone(&subject, &settings(&subject, Denoiser::ATROUS, true)).frame(0).linear.into_left();
        // The lower half shows the floor alone.
        let floor = &frame.pixels[frame.pixels.len() / 2..];
        assert!(floor.iter().any(|p| p[0] > 0.1) && floor.iter().all(|p| p[1] <= 1e-6), "{alpha_mode:?}");
    }
}

#[test]
fn texture_filtering_spares_auxiliary_images() {
    let subject = floor("matte", |_| ());
    let albedo = |filter| {
        let mut settings = settings(&subject, Denoiser::SVGF, filter);
        settings.buffers.aovs = vec![Aov::Albedo];
        let mut stage = Stage::alone(&subject, &settings);
        stage.frame(0);
        stage.aov(0)
    };
    let [filtered, sampled] = [true, false].map(albedo);
    assert!(filtered.left() == sampled.left() && filtered.right() == sampled.right());
}
