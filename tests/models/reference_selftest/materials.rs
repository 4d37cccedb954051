//! Closed forms: coats, maps, textures of the material model, and unlit surfaces.

use std::f64::consts::PI;

use diptych::image::{Extent, Image};
use diptych::scene::{Clearcoat, Environment, Light, LightKind, Material, Mesh, NormalMap, Scene, TextureRef};
use glam::{Affine3A, DVec3, Vec3, vec2, vec3, vec4};

use crate::reference::asserts::assert_exact;
use crate::reference::scenes::{add_material, add_mesh, add_texture, empty, instance, matte, place, quad};
use crate::reference::ztest::Estimate;
use crate::reference::{Emitters, Reference};

const BLACK: glam::Vec4 = vec4(0.0, 0.0, 0.0, 1.0);

/// Adds a texture with the same texel everywhere.
fn flat_texture(scene: &mut Scene, code: [u8; 4]) -> Option<TextureRef> {
    Some(add_texture(scene, Image::filled(Extent::new(1, 1), code), true))
}

/// Returns a mesh in the plane y = 0 that faces up, with tangents along +x.
fn plane(material: usize) -> Mesh {
    let mut mesh = quad(vec3(-5.0, 0.0, -5.0), 10.0 * Vec3::Z, 10.0 * Vec3::X, material);
    mesh.tangents = vec![vec4(1.0, 0.0, 0.0, 1.0); 4];
    mesh.uvs[0] = vec![vec2(0.5, 0.5); 4];
    mesh
}

fn look_down(scene: &Scene, spp: u32) -> Estimate {
    Reference::new(scene).probe(vec3(0.0, 1.0, 0.0), Vec3::NEG_Y, spp, 0, 1)
}

fn sun(scene: &mut Scene, direction: Vec3) {
    let kind = LightKind::Directional { direction: direction.normalize(), angle_rad: 0.0 };
    scene.lights.push(Light { kind, strength: Vec3::splat(PI as f32) });
}

#[test]
fn coat_reflects_by_fresnel_and_dims_its_base() {
    let mut scene = empty("coat");
    let clearcoat = Clearcoat { factor: 0.5, ..Clearcoat::default() };
    let material =
        add_material(&mut scene, Material { base_color: BLACK, emissive: Vec3::splat(3.0), clearcoat, ..matte() });
    place(&mut scene, plane(material));
    assert_exact(&look_down(&scene, 10), [3.0 * (1.0 - 0.5 * 0.04); 3]);
    scene.environment = Environment::Constant(Vec3::ONE);
    assert_exact(&look_down(&scene, 10), [3.0 * (1.0 - 0.5 * 0.04) + 0.5 * 0.04; 3]);
}

/// A coated lamp lights a screen equally through light sampling and through bounces.
#[test]
fn estimators_agree_on_coated_and_unlit_lamps() {
    let clearcoat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let lamps = [
        Material { emissive: Vec3::splat(3.0), base_color: BLACK, clearcoat, ..matte() },
        Material { base_color: vec4(3.0, 2.0, 1.0, 1.0), unlit: true, ..matte() },
    ];
    for lamp in lamps {
        let mut scene = empty("lamp");
        let white = add_material(&mut scene, matte());
        place(&mut scene, plane(white));
        let lamp = add_material(&mut scene, lamp);
        place(&mut scene, quad(vec3(-1.0, 1.0, -1.0), 2.0 * Vec3::X, 2.0 * Vec3::Z, lamp));
        let look = |emitters| {
            let reference = Reference::new(&scene).with_emitters(emitters);
            reference.probe(vec3(0.4, 0.5, 0.2), vec3(-0.4, -0.5, -0.2), 100_000, 0, 2)
        };
        crate::reference::ztest::assert_agrees("lamp", &look(Emitters::Sampled), &look(Emitters::BounceHits), 0.03);
    }
}

#[test]
fn unlit_surfaces_show_only_their_colour() {
    let mut scene = empty("unlit");
    let shown = Material { base_color: vec4(0.2, 0.4, 0.6, 1.0), emissive: Vec3::ONE, unlit: true, ..matte() };
    let material = add_material(&mut scene, shown);
    place(&mut scene, plane(material));
    sun(&mut scene, Vec3::NEG_Y);
    scene.environment = Environment::Constant(Vec3::ONE);
    assert_exact(&look_down(&scene, 2), [0.2, 0.4, 0.6]);
    assert_exact(&Reference::new(&scene).probe(Vec3::NEG_Y, Vec3::Y, 2, 3, 1), [0.2, 0.4, 0.6]);
}

/// Red tilts a map's normal along the tangent and green along the bitangent, on both sides and in a mirror.
#[test]
fn normal_map_turns_the_cosine() {
    let code = [204u8, 153, 230, 0];
    let local = DVec3::new(204.0, 153.0, 230.0) / 255.0 * 2.0 - 1.0;
    for (scale, w, mirrored) in [(1.0f32, 1.0f32, false), (0.5, 1.0, false), (1.0, -1.0, false), (1.0, 1.0, true)] {
        let mut scene = empty("map");
        let texture = flat_texture(&mut scene, code).unwrap();
        let material = Material { normal_map: Some(NormalMap { texture, scale }), ..matte() };
        let material = add_material(&mut scene, material);
        let mut mesh = plane(material);
        mesh.tangents = vec![vec4(1.0, 0.0, 0.0, w); 4];
        let mesh = add_mesh(&mut scene, mesh);
        let mirror = if mirrored { vec3(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        instance(&mut scene, mesh, Affine3A::from_scale(mirror));
        let to_sun = vec3(0.3, 0.9, -0.2).normalize();
        let mut below = scene.clone();
        sun(&mut scene, -to_sun);
        sun(&mut below, to_sun);
        // Up is y, along is x, and across is up × along = −z; mirroring in x flips the direction along.
        let (x, y) = (local.x * f64::from(scale), local.y * f64::from(scale));
        let along = if mirrored { -1.0 } else { 1.0 };
        let normal = DVec3::new(along * x, local.z, -y * f64::from(w)).normalize();
        let expected = normal.dot(to_sun.as_dvec3());
        assert_exact(&look_down(&scene, 2), [expected; 3]);
        // From below, everything is flipped.
        let seen = Reference::new(&below).probe(Vec3::NEG_Y, Vec3::Y, 2, 0, 1);
        assert_exact(&seen, [expected; 3]);
    }
}

/// A mapped normal that faces away from the viewer is bent until the viewer just sees it.
#[test]
fn normal_facing_away_is_bent_to_the_viewer() {
    let mut scene = empty("bent");
    let texture = flat_texture(&mut scene, [255, 128, 128, 0]).unwrap(); // along +x
    let material = Material { normal_map: Some(NormalMap { texture, scale: 1.0 }), ..matte() };
    let material = add_material(&mut scene, material);
    place(&mut scene, plane(material));
    let to_sun = vec3(0.6, 0.8, 0.0);
    sun(&mut scene, -to_sun);
    let code = 2.0 * 128.0 / 255.0 - 1.0;
    let normal = DVec3::new(1.0, code, -code).normalize();
    let v = DVec3::new(-0.8, 0.6, 0.0);
    let bent = (normal + v * (0.001 - normal.dot(v))).normalize();
    let seen = Reference::new(&scene).probe(v.as_vec3(), -v.as_vec3(), 2, 0, 1);
    assert_exact(&seen, [bent.dot(to_sun.as_dvec3()); 3]);
}

/// A factor times its texture channel equals the product as a factor. Codes are linear or sRGB as the model defines.
#[test]
fn textures_multiply_their_factors_channel_by_channel() {
    let mut plain = empty("plain");
    let mut textured = empty("textured");
    // Codes 51, 102, 153 and 204 are 0.2, 0.4, 0.6 and 0.8 of the factor.
    let all = flat_texture(&mut textured, [51, 102, 153, 204]);
    // sRGB code 188 is 0.502886 linear.
    let half = flat_texture(&mut textured, [188, 188, 188, 7]);
    let half_of = |x: f32| 0.502_886_5 * x;
    let coat = Clearcoat { factor: 1.0, roughness: 0.9, ..Clearcoat::default() };
    let material =
        Material { roughness: 0.8, metallic: 0.5, specular: 0.9, specular_color: Vec3::splat(1.2), ..matte() };
    let textures = Material {
        metallic_roughness_texture: all,
        specular_texture: all,
        specular_color_texture: half,
        transmission: 0.5,
        transmission_texture: all,
        clearcoat: Clearcoat { factor_texture: all, roughness_texture: all, ..coat },
        ..material.clone()
    };
    let factors = Material {
        roughness: 0.8 * 0.4,
        metallic: 0.5 * 0.6,
        specular: 0.9 * 0.8,
        specular_color: Vec3::splat(half_of(1.2)),
        transmission: 0.5 * 0.2,
        clearcoat: Clearcoat { factor: 0.2, roughness: 0.9 * 0.4, ..coat },
        ..material
    };
    for (scene, material) in [(&mut plain, factors), (&mut textured, textures)] {
        let material = add_material(scene, material);
        place(scene, plane(material));
        sun(scene, vec3(-0.2, -1.0, 0.1));
    }
    let [expected, found] = [&plain, &textured].map(|scene| look_down(scene, 2).mean[0]);
    for (e, f) in expected.iter().zip(found) {
        assert!(*e > 0.3 && (e - f).abs() < 1e-5 * e, "{found:?} is not {expected:?}");
    }
}
