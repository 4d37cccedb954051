//! A studio for materials: a floor, a large lamp, a uniform sky, and objects of one material.

use diptych::image::Extent;
use diptych::scene::{Environment, Material, Mesh, NormalMap, Scene, TextureRef, Volume};
use glam::{Affine2, Affine3A, Vec2, Vec3, vec2, vec3, vec4};

use super::pictures::{checker, steps, waves};
use super::{
    add_material, add_mesh, add_quad, add_texture, colored, empty, icosphere, instance, matte, place_at, quad,
    scaled_at,
};
use crate::reference::Pinhole;

/// A volume without attenuation, which makes glass solid.
pub const CLEAR: Option<Volume> = Some(Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY });

/// Returns an empty floor under a uniform sky.
pub fn ground(name: &str) -> Scene {
    let mut scene = empty(name);
    add_quad(&mut scene, (vec3(-3.0, 0.0, -3.0), 6.0 * Vec3::Z, 6.0 * Vec3::X), colored(vec3(0.5, 0.45, 0.4)));
    scene
}

/// Returns the ground, a uniform sky and a lamp of width 2 that shines down on it from the left.
pub fn studio(name: &str) -> Scene {
    let mut scene = ground(name);
    let lamp = Material { base_color: vec4(0.2, 0.2, 0.2, 1.0), emissive: vec3(2.5, 2.2, 1.8), ..matte() };
    add_quad(&mut scene, (vec3(-2.5, 2.2, -1.0), vec3(1.6, 0.8, 0.0), 2.0 * Vec3::Z), lamp);
    scene.environment = Environment::Constant(vec3(0.4, 0.5, 0.7));
    scene
}

/// Returns the camera for objects in a row.
pub fn camera() -> Pinhole {
    Pinhole::looking_at(vec3(0.0, 1.1, 4.0), vec3(0.0, 0.55, 0.0), Vec3::Y, 30.0)
}

/// Returns a dielectric with glTF's defaults.
pub fn dielectric(base: Vec3, roughness: f32) -> Material {
    Material { base_color: base.extend(1.0), roughness, specular: 1.0, ..matte() }
}

pub fn metal(base: Vec3, roughness: f32) -> Material {
    Material { base_color: base.extend(1.0), roughness, metallic: 1.0, specular: 1.0, ..matte() }
}

pub fn glass(base: Vec3, roughness: f32) -> Material {
    Material { transmission: 1.0, ..dielectric(base, roughness) }
}

/// Adds balls of radius 0.45 side by side, one of each material; returns their camera.
pub fn add_balls<const N: usize>(scene: &mut Scene, materials: [Material; N]) -> Pinhole {
    for (i, material) in materials.into_iter().enumerate() {
        let material = add_material(scene, material);
        place_at(scene, icosphere(2, true, material), scaled_at(0.45, vec3(spread(i, N), 0.5, 0.0)));
    }
    camera()
}

/// Adds upright panels side by side, one of each material, with both coordinate sets, tangents and an open back. Every
/// second one is mirrored. Returns their camera.
pub fn add_panels<const N: usize>(scene: &mut Scene, materials: [Material; N]) -> Pinhole {
    for (i, material) in materials.into_iter().enumerate() {
        let material = add_material(scene, material);
        let mesh = add_mesh(scene, panel(material));
        let mirror = if i % 2 == 1 { vec3(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        let at = Affine3A::from_translation(vec3(spread(i, N), 0.55, 0.0));
        instance(scene, mesh, at * Affine3A::from_scale(mirror));
    }
    camera()
}

fn spread(i: usize, n: usize) -> f32 {
    1.05 * (i as f32 - 0.5 * (n as f32 - 1.0))
}

/// Returns a panel of 0.9 × 1 around the origin that leans back and faces +z. Its interior tangents are neither unit
/// nor in the plane.
fn panel(material: usize) -> Mesh {
    let mut mesh = quad(vec3(-0.45, -0.5, 0.1), 0.9 * Vec3::X, vec3(0.0, 1.0, -0.25), material);
    let along = |x: f32, y: f32| vec3(1.0, x, y).normalize().extend(1.0);
    mesh.tangents = vec![along(0.0, 0.1), along(0.3, 0.0), along(-0.2, 0.1), along(0.1, -0.1)];
    let up = vec3(0.0, 0.25, 1.0).normalize();
    mesh.normals = [-0.15f32, 0.15, 0.15, -0.15].map(|x| (up + x * Vec3::X).normalize()).to_vec();
    mesh.uvs = [
        vec![vec2(0.0, 1.0), Vec2::ONE, vec2(1.0, 0.0), Vec2::ZERO],
        vec![vec2(1.2, 0.1), vec2(1.0, 1.3), vec2(-0.3, 1.0), vec2(0.0, -0.2)],
    ];
    mesh
}

/// Images for textures; see [`Pictures::add`].
#[derive(Clone, Copy)]
pub struct Pictures {
    pub checker: TextureRef,
    pub waves: TextureRef,
    pub steps: TextureRef,
}

impl Pictures {
    /// Adds the textures. All repeat, are bilinear, and use coordinate set 0.
    pub fn add(scene: &mut Scene) -> Self {
        let mut add = |image| add_texture(scene, image, true);
        Self {
            checker: add(checker(Extent::new(7, 5))),
            waves: add(waves(Extent::new(8, 8))),
            steps: add(steps(Extent::new(4, 4))),
        }
    }

    pub fn normal_map(&self, scale: f32) -> Option<NormalMap> {
        Some(NormalMap { texture: self.waves, scale })
    }
}

/// Returns the texture on the second coordinate set.
pub fn second(texture: TextureRef) -> TextureRef {
    TextureRef { uv_set: 1, ..texture }
}

/// Returns the texture with a transform that rotates, scales and shifts it.
pub fn turned(texture: TextureRef) -> TextureRef {
    TextureRef { uv_from_uv: Affine2::from_scale_angle_translation(vec2(1.3, 0.8), 0.5, vec2(0.2, -0.1)), ..texture }
}
