//! The scene's tables as shaders read them.

use std::mem::offset_of;

use glam::{UVec2, Vec2, Vec3, Vec4};

use crate::accel::{Instance, MAX_DEPTH, Node};
use crate::wgsl::{Constant, ROW_BYTES, Table, shared_constants, shared_structs};

shared_structs! {
    /// Factors of glTF's metallic-roughness material and its extensions, and the textures that multiply them.
    pub struct Material {
        pub base_color: Vec4,
        pub emissive: Vec3,
        pub pad0: u32,
        pub roughness: f32,
        pub metallic: f32,
        pub alpha_cutoff: f32,
        /// Bits such as [`DOUBLE_SIDED`].
        pub flags: u32,
        pub ior: f32,
        pub specular: f32,
        pub transmission: f32,
        pub clearcoat: f32,
        pub specular_color: Vec3,
        pub clearcoat_roughness: f32,
        /// Absorption coefficient inside the volume, per scene unit.
        pub absorption: Vec3,
        pub normal_scale: f32,
        pub clearcoat_normal_scale: f32,
        /// Index of the material's first entry in `textures`. The material has `texture_count` consecutive entries,
        /// those of base colour and emission first, in this order.
        pub first_texture: u32,
        pub texture_count: u32,
        pub pad1: u32,
        pub sheen_color: Vec3,
        pub sheen_roughness: f32,
        pub diffuse_transmission_color: Vec3,
        pub diffuse_transmission: f32,
        pub iridescence: f32,
        pub film_ior: f32,
        /// Thickness of the film where its texture is 0 and where it is 1, nanometres.
        pub film_thickness: Vec2,
        /// Cosine and sine of the rotation.
        pub anisotropy_direction: Vec2,
        pub anisotropy: f32,
        /// Largest difference of an index of refraction to that of green light.
        pub dispersion: f32,
    }

    /// A texture as one material refers to it. Texels are stored consecutively in pages of [`PAGE`] x [`PAGE`].
    pub struct TextureInfo {
        /// Index of the top left texel.
        pub first: u32,
        /// Size, texels.
        pub width: u32,
        pub height: u32,
        /// Bits such as [`TEXTURE_LINEAR`]; wrap modes of two bits each, from bits [`WRAP_U_SHIFT`] and
        /// [`WRAP_V_SHIFT`] on; [`TextureRole`], five bits from [`ROLE_SHIFT`] on.
        pub flags: u32,
        /// uv' = (m00 u + m01 v + tx, m10 u + m11 v + ty) as `KHR_texture_transform`.
        pub uv_matrix: Vec4,
        pub uv_offset: Vec2,
        pub pad: UVec2,
    }

    /// A light that can be sampled.
    pub struct Light {
        /// Triangle: unused. Local: position. Directional: direction towards the light.
        pub position: Vec3,
        /// [`LIGHT_SPOT`], [`LIGHT_TRIANGLE`] or 0.
        pub kind: u32,
        /// Triangle: unused (materials hold it). Local: W/sr, or radiance of a sphere. Directional: W/m2.
        pub strength: Vec3,
        /// Triangle: area. Local: radius of the sphere. Directional: 1 - cos of the disc's half-angle.
        pub radius: f32,
        /// Triangle: normal. Spot: axis.
        pub axis: Vec3,
        pub cos_outer: f32,
        /// Spot: 1 / (cos_inner - cos_outer).
        pub cone_scale: f32,
        /// Directional: probability within the group of directional lights. Sampling uses an alias table: it keeps this
        /// entry with probability `keep` and takes `alias_index` otherwise.
        pub pick: f32,
        pub keep: f32,
        pub alias_index: u32,
        /// Triangle: its index in the triangle table.
        pub prim: u32,
        /// Path through the light tree: bit k is set if it takes the second child at level k.
        pub trail: u32,
        pub pad: UVec2,
    }

    /// The second set of texture coordinates of a triangle's corners.
    pub struct SecondUvs {
        pub uv0: Vec2,
        pub uv1: Vec2,
        pub uv2: Vec2,
        pub pad: Vec2,
    }

    /// Entry of the grid over the environment image: `keep` and `alias_index` of the alias table over the grid's
    /// patches, and the density at the centre of a cell, relative to the (u, v) unit square.
    pub struct EnvCell {
        pub keep: f32,
        pub alias_index: u32,
        pub density: f32,
        pub pad: u32,
    }

    /// First row of each table; 0 for an absent, empty table.
    pub struct Tables {
        pub triangles: u32,
        pub shadings: u32,
        /// Three rows per triangle.
        pub vertex_colors: u32,
        pub second_uvs: u32,
        /// Three rows per triangle.
        pub tangents: u32,
        pub materials: u32,
        pub textures: u32,
        /// Spheres first, then other local lights, then directional ones.
        pub lights: u32,
        pub env_cells: u32,
        /// One row per 8-bit code.
        pub srgb: u32,
        /// Directional albedo of GGX reflection: one row per grid node, then one per roughness with the mean.
        pub albedo: u32,
        /// Three rows per deforming triangle: its corners' positions in the previous frame.
        pub last_corners: u32,
    }
}

/// Tables whose entries shaders read by generated functions.
pub(super) const TABLES: &[Table] = &[
    Table { entry: "Triangle", reader: "stored_triangle", first_row: "triangles" },
    Table { entry: "Shading", reader: "stored_shading", first_row: "shadings" },
    Table { entry: "SecondUvs", reader: "stored_second_uvs", first_row: "second_uvs" },
    Table { entry: "Material", reader: "stored_material", first_row: "materials" },
    Table { entry: "TextureInfo", reader: "stored_texture", first_row: "textures" },
    Table { entry: "Light", reader: "stored_light", first_row: "lights" },
    Table { entry: "EnvCell", reader: "stored_env_cell", first_row: "env_cells" },
];

/// Declares the purposes of a material's texture, with the names of their constants in shaders.
macro_rules! texture_roles {
    ($($role:ident $constant:literal,)*) => {
        /// Purpose of a material's texture.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u32)]
        pub enum TextureRole {
            $($role,)*
        }

        pub(super) const ROLES: &[Constant] = &[$(($constant, TextureRole::$role as u32),)*];
    };
}

texture_roles! {
    BaseColor "ROLE_BASE_COLOR",
    Emissive "ROLE_EMISSIVE",
    MetallicRoughness "ROLE_METALLIC_ROUGHNESS",
    Normal "ROLE_NORMAL",
    Specular "ROLE_SPECULAR",
    SpecularColor "ROLE_SPECULAR_COLOR",
    Transmission "ROLE_TRANSMISSION",
    Clearcoat "ROLE_CLEARCOAT",
    ClearcoatRoughness "ROLE_CLEARCOAT_ROUGHNESS",
    ClearcoatNormal "ROLE_CLEARCOAT_NORMAL",
    SheenColor "ROLE_SHEEN_COLOR",
    SheenRoughness "ROLE_SHEEN_ROUGHNESS",
    DiffuseTransmission "ROLE_DIFFUSE_TRANSMISSION",
    DiffuseTransmissionColor "ROLE_DIFFUSE_TRANSMISSION_COLOR",
    Iridescence "ROLE_IRIDESCENCE",
    FilmThickness "ROLE_FILM_THICKNESS",
    Anisotropy "ROLE_ANISOTROPY",
}

impl TextureRole {
    /// Whether it holds sRGB-encoded colours.
    pub fn is_color(self) -> bool {
        use TextureRole::*;
        matches!(self, BaseColor | Emissive | SpecularColor | SheenColor | DiffuseTransmissionColor)
    }
}

shared_constants! {
    /// Bits of [`Material::flags`].
    pub const DOUBLE_SIDED: u32 = 1;
    pub const ALPHA_MASK: u32 = 2;
    pub const ALPHA_BLEND: u32 = 4;
    /// Material that encloses a volume. Otherwise transmission passes through a thin sheet.
    pub const THICK: u32 = 8;
    pub const UNLIT: u32 = 16;
    pub const BASE_COLOR_TEXTURE: u32 = 32;
    pub const EMISSIVE_TEXTURE: u32 = 64;
    pub const NORMAL_MAP: u32 = 128;
    pub const CLEARCOAT_NORMAL_MAP: u32 = 256;
    pub const MIRROR: u32 = 512;
    pub const CLEAR_GLASS: u32 = 1024;
    pub const POLISHED: u32 = 2048;

    /// Bits of [`TextureInfo::flags`]: linear filtering, second set of texture coordinates, sRGB encoding.
    pub const TEXTURE_LINEAR: u32 = 1;
    pub const TEXTURE_SECOND_UVS: u32 = 2;
    pub const TEXTURE_SRGB: u32 = 64;
    pub const WRAP_U_SHIFT: u32 = 2;
    pub const WRAP_V_SHIFT: u32 = 4;
    pub const ROLE_SHIFT: u32 = 8;

    /// Wrap modes.
    pub const WRAP_REPEAT: u32 = 0;
    pub const WRAP_MIRROR: u32 = 1;
    pub const WRAP_CLAMP: u32 = 2;

    /// Edge length of a page, texels.
    pub const PAGE: u32 = 2048;

    /// Values of [`Light::kind`].
    pub const LIGHT_SPOT: u32 = 1;
    pub const LIGHT_TRIANGLE: u32 = 2;

    /// Placeholder for the number of a light that does not exist.
    pub const NO_LIGHT: u32 = u32::MAX;

    /// Bits of the last word of a light tree node. `LIGHT_LEAF`: the node is a leaf, and the word holds the index of a
    /// light instead of that of the first child. `LIGHT_TWO_SIDED`: the node's lights also emit in the opposite
    /// directions.
    pub const LIGHT_LEAF: u32 = 1 << 31;
    pub const LIGHT_TWO_SIDED: u32 = 1 << 30;

    /// Maximum depth of the light tree, since a trail has one bit per level.
    pub const LIGHT_LEVELS: u32 = 32;

    /// Width of the texture that stores the tables, texels. Each texel holds one table row.
    pub const TABLE_WIDTH: u32 = 8192;

    /// Number of table rows per node of the triangles' trees and per instance. The next three are row offsets within an
    /// instance: of its inverse matrix, its header and its previous matrix.
    const ROWS_PER_NODE: u32 = (size_of::<Node>() / ROW_BYTES) as u32;
    const ROWS_PER_INSTANCE: u32 = (size_of::<Instance>() / ROW_BYTES) as u32;
    const LOCAL_FROM_WORLD: u32 = (offset_of!(Instance, local_from_world) / ROW_BYTES) as u32;
    const INSTANCE_HEADER: u32 = (offset_of!(Instance, first_prim) / ROW_BYTES) as u32;
    const LAST_WORLD_FROM_LOCAL: u32 = (offset_of!(Instance, last_world_from_local) / ROW_BYTES) as u32;

    /// Nodes of the albedo table along the cosine and along perceptual roughness, both from 0 to 1.
    pub const ALBEDO_GRID: u32 = 32;

    /// Maximum depth of the trees that a ray traverses, instances included.
    const STACK_SIZE: u32 = MAX_DEPTH as u32;
}

/// Squared perceptual roughness below which a surface is a mirror.
pub const SMOOTH: f32 = 1e-4;
/// Minimum roughness of a sheen: below it, only light at grazing angles would be scattered.
pub const LEAST_SHEEN_ROUGHNESS: f32 = 0.07;
