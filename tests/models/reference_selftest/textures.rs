//! Textures and alpha.

use std::f64::consts::PI;

use diptych::image::{Extent, Image};
use diptych::scene::{AlphaMode, Environment, Material, Scene, Texture, TextureRef, Wrap};
use glam::{Affine2, DVec2, Vec2, Vec3, vec2, vec3, vec4};

use super::{floor, look_at_floor, point, white_floor};
use crate::reference::asserts::{assert_exact, assert_near};
use crate::reference::scenes::{add_image, add_material, empty, matte, place, quad};
use crate::reference::texture::{self, Encoding};
use crate::reference::ztest::{Estimate, assert_agrees};
use crate::reference::{Emitters, Reference};

fn checker_scene(wrap_u: Wrap, wrap_v: Wrap, linear: bool) -> Scene {
    let mut scene = empty("texture");
    let mut image = Image::filled(Extent::new(2, 2), [0u8; 4]);
    image.pixels = vec![[255, 0, 0, 255], [0, 128, 0, 0], [0, 0, 255, 51], [255, 255, 255, 102]];
    let image = add_image(&mut scene, image);
    scene.textures.push(Texture { image, wrap_u, wrap_v, linear });
    scene
}

/// References the only texture, without a transform of its coordinates.
const fn texture_ref(uv_set: usize) -> TextureRef {
    TextureRef { texture: 0, uv_set, uv_from_uv: Affine2::IDENTITY }
}

/// sRGB code 128, decoded.
const MIDDLE: f64 = 0.215_860_500_113_899_26;

#[test]
fn texels_are_decoded_before_filtering() {
    let scene = checker_scene(Wrap::Repeat, Wrap::Repeat, true);
    let at = |u, v| {
        let reference = texture_ref(0);
        texture::look_up(&scene, reference, DVec2::new(u, v), Encoding::Srgb).to_array()
    };
    let close = |a: [f64; 4], b: [f64; 4]| {
        assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-12), "{a:?} is not {b:?}");
    };
    close(at(0.25, 0.25), [1.0, 0.0, 0.0, 1.0]);
    close(at(0.75, 0.25), [0.0, MIDDLE, 0.0, 0.0]);
    close(at(0.25, 0.75), [0.0, 0.0, 1.0, 0.2]);
    close(at(0.5, 0.25), [0.5, MIDDLE / 2.0, 0.0, 0.5]);
    close(at(0.5, 0.5), [0.5, (MIDDLE + 1.0) / 4.0, 0.5, 0.4]);
    close(at(0.0, 0.25), [0.5, MIDDLE / 2.0, 0.0, 0.5]); // across the seam
    close(at(0.35, 0.25), [0.8, 0.2 * MIDDLE, 0.0, 0.8]);
    close(at(-2.65, 7.25), at(0.35, 0.25));
}

#[test]
fn coordinates_are_transformed_before_the_lookup() {
    let scene = checker_scene(Wrap::Repeat, Wrap::Repeat, true);
    let turned = Affine2::from_scale_angle_translation(vec2(2.0, 0.5), 0.3, vec2(0.1, -0.2));
    let look = |reference, uv: Vec2| texture::look_up(&scene, reference, uv.as_dvec2(), Encoding::Srgb);
    let uv = vec2(0.3, 0.8);
    let expected = look(texture_ref(0), turned.transform_point2(uv));
    let found = look(TextureRef { uv_from_uv: turned, ..texture_ref(0) }, uv);
    assert!((found - expected).abs().max_element() < 1e-6, "{found} is not {expected}");
}

#[test]
fn wrap_modes_repeat_mirror_and_clamp() {
    let row = |mode, n| (-4..8).map(|i| texture::wrap(f64::from(i), n, mode)).collect::<Vec<_>>();
    assert_eq!(row(Repeat, 3), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1]);
    assert_eq!(row(MirroredRepeat, 3), [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
    assert_eq!(row(ClampToEdge, 3), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2, 2]);

    let look = |wrap_u, wrap_v, u: f64, v: f64| {
        let scene = checker_scene(wrap_u, wrap_v, false);
        texture::look_up(&scene, texture_ref(0), DVec2::new(u, v), Encoding::Srgb).w
    };
    use Wrap::{ClampToEdge, MirroredRepeat, Repeat};
    assert_eq!(look(Repeat, ClampToEdge, 1.1, 1.6), 0.2);
    assert_eq!(look(MirroredRepeat, ClampToEdge, 1.1, 1.6), 0.4);
    assert_eq!(look(ClampToEdge, Repeat, 1.1, 1.1), 0.0);
    assert_eq!(look(ClampToEdge, MirroredRepeat, -0.1, 1.1), 0.2);
}

/// Adds a quad in the plane z = 0, 1 × 1 from the origin, textured with v down, in front of a sky of 1.
fn textured_quad(material: Material, colors: Vec<glam::Vec4>, linear: bool) -> Scene {
    let mut scene = checker_scene(Wrap::ClampToEdge, Wrap::ClampToEdge, linear);
    let material = add_material(&mut scene, material);
    let mut mesh = quad(Vec3::ZERO, Vec3::X, Vec3::Y, material);
    mesh.uvs[1] = vec![vec2(0.0, 1.0), Vec2::ONE, vec2(1.0, 0.0), Vec2::ZERO];
    mesh.colors = colors;
    place(&mut scene, mesh);
    scene.environment = Environment::Constant(Vec3::ONE);
    scene
}

fn through(scene: &Scene, x: f32, y: f32, spp: u32) -> Estimate {
    Reference::new(scene).probe(vec3(x, y, 2.0), Vec3::NEG_Z, spp, 0, 7)
}

const SECOND_SET: Option<TextureRef> = Some(texture_ref(1));

#[test]
fn textured_surface_multiplies_all_its_colours() {
    let material = Material {
        base_color: vec4(0.5, 0.5, 0.5, 1.0),
        base_color_texture: SECOND_SET,
        emissive: vec3(2.0, 4.0, 8.0),
        emissive_texture: SECOND_SET,
        ..matte()
    };
    let scene = textured_quad(material, vec![vec4(0.5, 0.25, 1.0, 1.0); 4], false);
    // Under a white sky, the radiance is albedo + emission.
    assert_exact(&through(&scene, 0.2, 0.8, 20), [0.25 + 2.0, 0.0, 0.0]);
    assert_exact(&through(&scene, 0.8, 0.8, 20), [0.0, (0.125 + 4.0) * MIDDLE, 0.0]);
    assert_exact(&through(&scene, 0.2, 0.2, 20), [0.0, 0.0, 0.5 + 8.0]);
}

#[test]
fn alpha_mask_covers_at_its_cutoff_and_above() {
    let material = |cutoff| Material {
        base_color: vec4(0.0, 0.0, 0.0, 0.5),
        base_color_texture: SECOND_SET,
        alpha_mode: AlphaMode::Mask { cutoff },
        ..matte()
    };
    let covered = |cutoff: f32, x: f32, y: f32| {
        let scene = textured_quad(material(cutoff), vec![vec4(1.0, 1.0, 1.0, 0.5); 4], false);
        through(&scene, x, y, 2).mean[0] == [0.0; 3]
    };
    // Alpha is 0.25 × 1, 0, 0.2, 0.4.
    assert!(covered(0.25, 0.2, 0.8));
    assert!(!covered(0.2501, 0.2, 0.8));
    assert!(covered(0.0, 0.8, 0.8));
    assert!(!covered(0.06, 0.2, 0.2));
    assert!(covered(0.06, 0.8, 0.2));
}

#[test]
fn blending_covers_with_probability_alpha() {
    let veil = Material {
        base_color: vec4(0.0, 0.0, 0.0, 0.5),
        emissive: Vec3::splat(3.0),
        alpha_mode: AlphaMode::Blend,
        ..matte()
    };
    let scene = textured_quad(veil.clone(), vec![vec4(1.0, 1.0, 1.0, 0.6); 4], false);
    assert_near(&through(&scene, 0.3, 0.4, 100_000), 0.3 * 3.0 + 0.7, 0.004);

    let mut scene = white_floor("veiled");
    let veil = add_material(&mut scene, Material { emissive: Vec3::ZERO, ..veil });
    for height in [0.5, 0.7] {
        place(&mut scene, quad(vec3(-0.05, height, -0.05), 0.1 * Vec3::X, 0.1 * Vec3::Z, veil));
    }
    scene.lights.push(point(Vec3::Y, 0.0, Vec3::splat(PI as f32)));
    assert_exact(&look_at_floor(&scene, 0.001, 0.002, 2, 0), {
        let d2: f64 = 1.0 + 5e-6;
        [0.25 / d2.powf(1.5); 3]
    });
}

/// Emission of a half-transparent lamp: explicit samples must be weighted by coverage, because bounces hit it only by
/// chance.
#[test]
fn estimators_agree_on_masked_and_blended_lamps() {
    for alpha_mode in [AlphaMode::Mask { cutoff: 0.3 }, AlphaMode::Blend] {
        let mut scene = checker_scene(Wrap::Repeat, Wrap::Repeat, true);
        floor(&mut scene, Vec3::ONE);
        let texture = Some(texture_ref(0));
        let lamp = Material {
            emissive: Vec3::ONE,
            base_color_texture: texture,
            emissive_texture: texture,
            alpha_mode,
            ..matte()
        };
        let lamp = add_material(&mut scene, lamp);
        let mut mesh = quad(vec3(-1.0, 1.0, -1.0), 2.0 * Vec3::X, 2.0 * Vec3::Z, lamp);
        mesh.uvs[0] = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        place(&mut scene, mesh);
        let look = |emitters| {
            let reference = Reference::new(&scene).with_emitters(emitters);
            reference.probe(vec3(0.5, 0.3, 0.1), vec3(-0.5, -0.3, 0.0), 500_000, 1, 8)
        };
        let (area, hits) = (look(Emitters::Sampled), look(Emitters::BounceHits));
        assert_agrees("lamp", &area, &hits, 0.03);
    }
}
