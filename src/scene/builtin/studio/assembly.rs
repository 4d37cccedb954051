//! Assembly of surfaces, materials and textures into a [`Scene`].

use std::sync::Arc;

use glam::{Affine2, Affine3A, Vec3};

use super::surface::Surface;
use crate::image::{Extent, Image};
use crate::scene::{Instance, Light, Material, Mesh, Scene, TexelImage, Texture, TextureRef, Wrap};

/// A scene under construction. Its shot adds the environment and static lights.
pub struct Assembly {
    scene: Scene,
}

impl Assembly {
    pub fn new(name: &str) -> Self {
        Self { scene: Scene::empty(name) }
    }

    pub fn material(&mut self, material: Material) -> usize {
        self.scene.materials.push(material);
        self.scene.materials.len() - 1
    }

    /// Adds a repeating texture that uses texture coordinate set 0, with nearest filtering.
    pub fn texture(&mut self, image: TexelImage) -> TextureRef {
        self.scene.images.push(Arc::new(image));
        let (image, wrap) = (self.scene.images.len() - 1, Wrap::Repeat);
        self.scene.textures.push(Texture { image, wrap_u: wrap, wrap_v: wrap, linear: false });
        TextureRef { texture: self.scene.textures.len() - 1, uv_set: 0, uv_from_uv: Affine2::IDENTITY }
    }

    /// Adds a mesh to be placed later. Returns its index.
    pub fn mesh(&mut self, surface: Surface, material: usize) -> usize {
        self.raw_mesh(surface.into_mesh(material))
    }

    pub fn raw_mesh(&mut self, mesh: Mesh) -> usize {
        self.scene.meshes.push(mesh);
        self.scene.meshes.len() - 1
    }

    /// Places a mesh. Returns the instance's index.
    pub fn instance(&mut self, mesh: usize, world_from_local: Affine3A) -> usize {
        self.scene.instances.push(Instance { mesh, world_from_local });
        self.scene.instances.len() - 1
    }

    /// Adds a dynamic light. Returns its index.
    pub fn light(&mut self, light: Light) -> usize {
        self.scene.lights.push(light);
        self.scene.lights.len() - 1
    }

    /// Adds a mesh and places it untransformed.
    pub fn add(&mut self, surface: Surface, material: usize) {
        let mesh = self.mesh(surface, material);
        self.instance(mesh, Affine3A::IDENTITY);
    }

    pub fn finish(self) -> Scene {
        self.scene
    }
}

/// Returns a Lambertian material.
pub fn matte(name: &str, color: [f32; 3]) -> Material {
    Material { name: name.into(), base_color: Vec3::from(color).extend(1.0), ..Material::default() }
}

/// Returns a glossy dielectric.
pub fn glossy(name: &str, color: [f32; 3], roughness: f32) -> Material {
    Material { roughness, specular: 1.0, ..matte(name, color) }
}

pub fn metal(name: &str, color: [f32; 3], roughness: f32) -> Material {
    Material { metallic: 1.0, ..glossy(name, color, roughness) }
}

/// Returns a Lambertian material coloured by a texture.
pub fn textured(name: &str, texture: TextureRef) -> Material {
    Material { base_color_texture: Some(texture), ..matte(name, [1.0; 3]) }
}

/// Makes a material double-sided, for thin sheets.
pub fn sheet(material: Material) -> Material {
    Material { double_sided: true, ..material }
}

/// Returns an emitter that reflects almost nothing.
pub fn emitter(name: &str, radiance: [f32; 3]) -> Material {
    Material { emissive: radiance.into(), ..matte(name, [0.0; 3]) }
}

/// Returns a checkerboard of `squares` × `squares` squares in two greys, as 8-bit sRGB values.
pub fn checker(size: u32, squares: u32, light: u8, dark: u8) -> TexelImage {
    Image::from_fn(Extent::new(size, size), |x, y| {
        let odd = (x * squares / size + y * squares / size) % 2 == 1;
        let grey = if odd { dark } else { light };
        [grey, grey, grey, 255]
    })
}
