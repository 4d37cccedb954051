//! Rows of materials at their limits.

use diptych::image::{Extent, Image};
use diptych::scene::{Clearcoat, Environment, Light, LightKind, Material, NormalMap, Scene, Volume};
use glam::{Affine3A, Vec3, Vec4, vec3};

use super::rows::{FULL, finite, mean_is, row};
use super::{Effort, Row};
use crate::reference::Pinhole;
use crate::reference::scenes::studio::{CLEAR, add_balls, add_panels, camera, dielectric, glass, metal, studio};
use crate::reference::scenes::{
    add_material, add_mesh, add_texture, block, icosphere, instance, matte, place, place_at, quad, scaled_at,
};

const SMOOTHNESSES: [f32; 3] = [0.0, 1e-3, 1.0];
const GREEN: Vec3 = vec3(0.6, 0.9, 0.7);

pub fn rows() -> Vec<Row> {
    let thick = |roughness| Material { volume: amber(0.5), ..glass(GREEN, roughness) };
    let coated = |roughness| {
        let clearcoat = Clearcoat { factor: 1.0, roughness, ..Clearcoat::default() };
        Material { clearcoat, emissive: Vec3::splat(1e-3), ..metal(GREEN, 1.0 - roughness) }
    };
    let of_ior = |ior| move |roughness| Material { ior, ..thick(roughness) };
    let opaque_of_ior = |ior| move |roughness| Material { ior, ..dielectric(GREEN, roughness) };
    let absorbing =
        [amber(1e-6), amber(1e30), Some(Volume { attenuation_color: Vec3::ZERO, attenuation_distance: 1.0 })];
    let unlit = Material { unlit: true, ..metal(GREEN, 0.0) };
    let everything = Material { transmission: 0.5, metallic: 0.5, normal_map: None, ..coated(0.3) };
    vec![
        row("metals", balls("metals", SMOOTHNESSES.map(|r| metal(GREEN, r))), FULL, finite()),
        row("thick glass", balls("thick glass", SMOOTHNESSES.map(thick)), FULL, finite()),
        row("thin glass", balls("thin glass", SMOOTHNESSES.map(|r| glass(GREEN, r))), FULL, finite()),
        row("clearcoats", balls("clearcoats", SMOOTHNESSES.map(coated)), FULL, finite()),
        row("glass of ior 1", balls("ior 1", SMOOTHNESSES.map(of_ior(1.0))), FULL, finite()),
        row("glass of ior 0", balls("ior 0", SMOOTHNESSES.map(of_ior(0.0))), FULL, finite()),
        row("glass of ior 1000", balls("ior 1000", SMOOTHNESSES.map(of_ior(1e3))), FULL, finite()),
        row("dielectrics of ior 0", balls("ior 0", SMOOTHNESSES.map(opaque_of_ior(0.0))), FULL, finite()),
        row("dielectrics of ior 1000", balls("ior 1000", SMOOTHNESSES.map(opaque_of_ior(1e3))), FULL, finite()),
        row("volumes", balls("volumes", absorbing.map(|volume| Material { volume, ..thick(0.0) })), FULL, finite()),
        row("all lobes, and unlit", balls("all lobes", [everything, unlit]), FULL, finite()),
        row("a camera in smooth glass", inside(thick(0.0)), FULL, finite()),
        row("a camera in rough glass", inside(thick(0.5)), FULL, finite()),
        row(
            "a camera in glass that lets nothing through",
            inside(Material { volume: amber(1e-6), ..thick(0.0) }),
            FULL,
            finite(),
        ),
        row("glass that touches lamps", touching(thick(0.0)), FULL, finite()),
        row("rough glass that touches lamps", touching(thick(0.4)), FULL, finite()),
        row("emission of 1e8 behind glass", bright([thick(0.0), thick(0.4), glass(GREEN, 0.3)]), FULL, finite()),
        row("normal maps of scale 1e6", mapped(1e6, true), FULL, finite()),
        row("normal maps of scale 1", mapped(1.0, true), FULL, finite()),
        row("normal maps without tangents", mapped(1.0, false), FULL, finite()),
        row("clear glass in a white sky", furnace(glass(Vec3::ONE, 0.0)), Effort::new(256, 100), mean_is(1.0, 1e-3)),
    ]
}

fn amber(attenuation_distance: f32) -> Option<Volume> {
    Some(Volume { attenuation_color: vec3(0.9, 0.6, 0.2), attenuation_distance })
}

fn balls<const N: usize>(name: &str, materials: [Material; N]) -> (Scene, Pinhole) {
    let mut scene = studio(name);
    let kind = LightKind::Point { position: vec3(0.3, 1.5, 1.0), radius: 0.1 };
    scene.lights.push(Light { kind, strength: Vec3::ONE });
    add_balls(&mut scene, materials);
    (scene, camera())
}

fn furnace(material: Material) -> (Scene, Pinhole) {
    let mut scene =
        Scene { environment: Environment::Constant(Vec3::ONE), ..crate::reference::scenes::empty("furnace") };
    add_balls(&mut scene, [Material { volume: CLEAR, ..material }]);
    (scene, camera())
}

/// Returns a camera in a ball, off its centre.
fn inside(material: Material) -> (Scene, Pinhole) {
    let mut scene = studio("inside");
    let material = add_material(&mut scene, material);
    place_at(&mut scene, icosphere(3, true, material), scaled_at(0.8, vec3(0.0, 0.9, 1.0)));
    (scene, Pinhole::looking_at(vec3(0.0, 1.0, 1.4), vec3(0.0, 0.7, 0.0), Vec3::Y, 60.0))
}

/// Returns a block with a lamp on its top that shines into it, one on its side that shines outwards, and one around a
/// light.
fn touching(material: Material) -> (Scene, Pinhole) {
    let mut scene = studio("touching");
    let material = add_material(&mut scene, material);
    let lamp = add_material(&mut scene, Material { emissive: Vec3::splat(20.0), ..matte() });
    let cube = add_mesh(&mut scene, block(material));
    instance(&mut scene, cube, Affine3A::from_translation(vec3(0.0, 0.5, 0.0)));
    place(&mut scene, quad(vec3(-0.5, 1.0, -0.5), Vec3::X, Vec3::Z, lamp));
    place(&mut scene, quad(vec3(0.5, 0.0, -0.5), Vec3::Y, Vec3::Z, lamp));
    instance(&mut scene, cube, scaled_at(0.5, vec3(-1.2, 0.25, 0.0)));
    let kind = LightKind::Point { position: vec3(-1.2, 0.25, 0.0), radius: 0.25 };
    scene.lights.push(Light { kind, strength: Vec3::splat(2.0) });
    (scene, camera())
}

fn bright<const N: usize>(materials: [Material; N]) -> (Scene, Pinhole) {
    let (mut scene, camera) = balls("bright", materials);
    let lamp = add_material(&mut scene, Material { emissive: Vec3::splat(1e8), ..matte() });
    place(&mut scene, quad(vec3(-1.5, 0.0, -0.8), 3.0 * Vec3::X, Vec3::Y, lamp));
    (scene, camera)
}

/// Returns normal maps that are black, white, or a texel without a direction.
fn mapped(scale: f32, has_tangents: bool) -> (Scene, Pinhole) {
    let mut scene = studio("mapped");
    let panels = [[0, 0, 0, 255], [255; 4], [128, 128, 128, 255]].map(|texel| {
        let texture = add_texture(&mut scene, Image::filled(Extent::new(2, 2), texel), true);
        let normal_map = Some(NormalMap { texture, scale });
        let clearcoat = Clearcoat { factor: 0.5, roughness: 0.2, normal_map, ..Clearcoat::default() };
        Material { normal_map, clearcoat, ..metal(GREEN, 0.1) }
    });
    add_panels(&mut scene, panels);
    if !has_tangents {
        for tangent in scene.meshes.iter_mut().flat_map(|mesh| &mut mesh.tangents) {
            *tangent = Vec4::ZERO;
        }
    }
    (scene, camera())
}
