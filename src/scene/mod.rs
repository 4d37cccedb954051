//! Scene description: geometry, materials, lights and environment, in scene units and linear colour.
//!
//! A [`Scene`] is plain, validated data. It comes from a glTF file or is [built in](builtin), plus the lights and
//! environment of a [shot](shot::Shot). It is independent of devices.

pub mod budget;
mod error;
pub mod complete;
pub mod folder;
pub mod optics;
pub mod rig;
mod rig_optics;
pub mod projection;
pub mod motion;
pub mod shot;
pub mod head;
pub mod gltf;
pub mod builtin;
pub mod environment;
mod eye;
mod light;
mod material;
pub mod load;
pub mod export;
pub mod needs;
pub mod studio;
pub mod viewpoint;

use std::sync::Arc;

use glam::{Affine2, Affine3A, Vec2, Vec3, Vec4};

use self::motion::{Influence, Morph, Motion};
pub use error::{Refusal, SceneError, Setting};
pub use light::{Light, LightKind, are_suns_hard};
pub use material::{Anisotropy, Clearcoat, DiffuseTransmission, Iridescence, Material, Sheen, Volume};

/// Geometry of one glTF primitive: triangles with one material, in local space.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    /// Unit normals, one per position; empty for flat shading.
    pub normals: Vec<Vec3>,
    /// Unit tangents with the bitangent's sign in w (glTF's TANGENT), one per position or empty. They are present if
    /// the material has a normal map, and zero where it cannot be applied.
    pub tangents: Vec<Vec4>,
    /// Texture coordinate sets 0 and 1; each has one entry per position or is empty.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours that multiply base colour and alpha; one per position or empty.
    pub colors: Vec<Vec4>,
    /// Vertex indices, counter-clockwise seen from the front, all below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// Skinning influences, used by instances with a skin: one per position or empty.
    pub influences: Vec<Influence>,
    /// Morph targets, for instances with weights.
    pub morphs: Vec<Morph>,
}

impl Mesh {
    /// Returns the number of bytes on the heap.
    pub fn bytes(&self) -> u64 {
        let Self { positions, normals, tangents, uvs: [uvs_0, uvs_1], colors, triangles, .. } = self;
        let vectors = held(positions) + held(normals) + held(tangents) + held(colors);
        vectors + held(uvs_0) + held(uvs_1) + held(triangles) + self.motion_bytes()
    }

    /// Returns the number of heap bytes of influences and morphs.
    pub fn motion_bytes(&self) -> u64 {
        let morph = |m: &Morph| held(&m.positions) + held(&m.normals) + held(&m.tangents);
        held(&self.influences) + held(&self.morphs) + self.morphs.iter().map(morph).sum::<u64>()
    }
}

fn held<T>(list: &Vec<T>) -> u64 {
    (list.capacity() * size_of::<T>()) as u64
}

/// A mesh placed in the world.
#[derive(Clone, Copy, Debug)]
pub struct Instance {
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    pub world_from_local: Affine3A,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    Opaque,
    /// Opaque if alpha >= cutoff, else fully transparent.
    Mask {
        cutoff: f32,
    },
    /// Opaque with probability alpha.
    Blend,
}

/// A material's reference to a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into [`Scene::textures`].
    pub texture: usize,
    /// Index into [`Mesh::uvs`].
    pub uv_set: usize,
    /// Transform from the mesh's texture coordinates to the sampled ones: `KHR_texture_transform`, else the identity.
    pub uv_from_uv: Affine2,
}

/// A normal map. Red and green hold x and y along tangent and bitangent, scaled by `scale`; they are linear, not sRGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalMap {
    pub texture: TextureRef,
    pub scale: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wrap {
    Repeat,
    MirroredRepeat,
    ClampToEdge,
}

/// An image with its sampler. `v` points down the image, and row 0 is at `v = 0` (glTF's convention).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texture {
    /// Index into [`Scene::images`].
    pub image: usize,
    pub wrap_u: Wrap,
    pub wrap_v: Wrap,
    /// Bilinear filtering, else nearest.
    pub linear: bool,
}

/// An image of 8-bit RGBA texels as stored in the file, without colour conversion, row-major from the top.
pub type TexelImage = crate::image::Image<[u8; 4]>;

/// Light from infinitely far away in all directions.
#[derive(Clone, Debug, PartialEq)]
pub enum Environment {
    Black,
    Constant(Vec3),
    /// Latitude-longitude radiance. Direction d maps to u = 0.5 + atan2(d.x, -d.z) / 2π + rotation / 360° and v =
    /// acos(d.y) / π. The image's centre is at −z, it runs towards +x to the right, and row 0 is up.
    Map {
        /// Image, shared with the tables that are built for devices.
        image: Arc<crate::image::RgbImage>,
        rotation_deg: f32,
    },
}

/// A glTF camera as a pinhole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub world_from_view: Affine3A,
    pub yfov_rad: f32,
}

#[derive(Clone, Debug)]
pub struct Scene {
    pub name: String,
    pub meshes: Vec<Mesh>,
    pub instances: Vec<Instance>,
    /// Materials, at least one.
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    /// Images, shared with the tables that are built for devices.
    pub images: Vec<Arc<TexelImage>>,
    pub lights: Vec<Light>,
    pub environment: Environment,
    pub cameras: Vec<Camera>,
    /// Motion of the scene. Instances, lights, cameras and materials hold their state at time 0.
    pub motion: Motion,
    /// Warnings about parts of the file that were left out or approximated, without duplicates.
    pub warnings: Vec<String>,
    /// Choices where the file says nothing, such as a viewpoint.
    pub notes: Vec<String>,
}

/// World-space bounds; `min > max` when empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub min: Vec3,
    pub max: Vec3,
}

impl Scene {
    /// Returns an empty scene of that name.
    pub fn empty(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            meshes: Vec::new(),
            instances: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            images: Vec::new(),
            lights: Vec::new(),
            environment: Environment::Black,
            cameras: Vec::new(),
            motion: Motion::default(),
            warnings: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Returns the number of triangles after instancing.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|i| self.meshes[i.mesh].triangles.len()).sum()
    }

    /// Returns the bounds of all instanced geometry.
    pub fn bounds(&self) -> Bounds {
        let mut b = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
        for instance in &self.instances {
            for &p in &self.meshes[instance.mesh].positions {
                let p = instance.world_from_local.transform_point3(p);
                b.min = b.min.min(p);
                b.max = b.max.max(p);
            }
        }
        b
    }
}
