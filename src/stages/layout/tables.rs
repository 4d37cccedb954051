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
        /// [`DOUBLE_SIDED`] and the others.
        pub flags: u32,
        pub ior: f32,
        pub specular: f32,
        pub transmission: f32,
        pub clearcoat: f32,
        pub specular_color: Vec3,
        pub clearcoat_roughness: f32,
        /// Inside a volume, per scene unit.
        pub absorption: Vec3,
        pub normal_scale: f32,
        pub clearcoat_normal_scale: f32,
        /// Its entries of `textures`, one after another; those of base colour and emission come first, in this order.
        pub first_texture: u32,
        pub texture_count: u32,
        pub pad1: u32,
    }

    /// A texture as one material refers to it. Texels lie one after another in pages of [`PAGE`] x [`PAGE`].
    pub struct TextureInfo {
        /// Index of the top left texel.
        pub first: u32,
        /// Texels.
        pub width: u32,
        pub height: u32,
        /// [`TEXTURE_LINEAR`] and the others; modes of wrapping from the bits [`WRAP_U_SHIFT`] and [`WRAP_V_SHIFT`] on, two
        /// each; [`TextureRole`] from [`ROLE_SHIFT`] on, four.
        pub flags: u32,
        /// uv' = (m00 u + m01 v + tx, m10 u + m11 v + ty) as `KHR_texture_transform`.
        pub uv_matrix: Vec4,
        pub uv_offset: Vec2,
        pub pad: UVec2,
    }

    /// A light that is picked.
    pub struct Light {
        /// Triangle: unused. Local: position. Directional: the way to the light.
        pub position: Vec3,
        /// [`LIGHT_SPOT`], [`LIGHT_TRIANGLE`] or 0.
        pub kind: u32,
        /// Triangle: unused (materials hold it). Local: W/sr, or radiance of a sphere. Directional: W/m2.
        pub strength: Vec3,
        /// Triangle: area. Local: of the sphere. Directional: 1 - cos of the disc's half-angle.
        pub radius: f32,
        /// Triangle: normal. Spot: axis.
        pub axis: Vec3,
        pub cos_outer: f32,
        /// Spot: 1 / (cos_inner - cos_outer).
        pub cone_scale: f32,
        /// Directional: probability in its group; alias table: keep this entry with probability `keep`, else take
        /// `alias_index`.
        pub pick: f32,
        pub keep: f32,
        pub alias_index: u32,
        /// Triangle: its number.
        pub prim: u32,
        /// The way through the light tree: bit k is set where it takes the second child at level k.
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

    /// Alias table and density of the grid over the environment image. Densities are over the map's (u, v) square.
    pub struct EnvCell {
        pub keep: f32,
        pub alias_index: u32,
        pub density: f32,
        pub pad: u32,
    }

    /// First rows of tables; 0 of those that are empty and need not be there.
    pub struct Tables {
        pub triangles: u32,
        pub shadings: u32,
        /// Three a triangle.
        pub vertex_colors: u32,
        pub second_uvs: u32,
        /// Three a triangle.
        pub tangents: u32,
        pub materials: u32,
        pub textures: u32,
        /// Spheres first, then other local lights, then directional ones.
        pub lights: u32,
        pub env_cells: u32,
        /// One code a row.
        pub srgb: u32,
        /// One node a row.
        pub albedo: u32,
        /// Three corners a triangle of bodies that deform, where they were in the frame before.
        pub last_corners: u32,
    }
}

/// Tables that shaders read by entries.
pub(super) const TABLES: &[Table] = &[
    Table { entry: "Triangle", reader: "stored_triangle", first_row: "triangles" },
    Table { entry: "Shading", reader: "stored_shading", first_row: "shadings" },
    Table { entry: "SecondUvs", reader: "stored_second_uvs", first_row: "second_uvs" },
    Table { entry: "Material", reader: "stored_material", first_row: "materials" },
    Table { entry: "TextureInfo", reader: "stored_texture", first_row: "textures" },
    Table { entry: "Light", reader: "stored_light", first_row: "lights" },
    Table { entry: "EnvCell", reader: "stored_env_cell", first_row: "env_cells" },
];

/// What a material's texture is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum TextureRole {
    BaseColor,
    Emissive,
    MetallicRoughness,
    Normal,
    Specular,
    SpecularColor,
    Transmission,
    Clearcoat,
    ClearcoatRoughness,
    ClearcoatNormal,
}

impl TextureRole {
    /// Whether it holds colours, sRGB-encoded.
    pub fn is_color(self) -> bool {
        matches!(self, Self::BaseColor | Self::Emissive | Self::SpecularColor)
    }
}

shared_constants! {
    /// Of [`Material::flags`].
    pub const DOUBLE_SIDED: u32 = 1;
    pub const ALPHA_MASK: u32 = 2;
    pub const ALPHA_BLEND: u32 = 4;
    /// Encloses a volume; transmission is through a thin sheet otherwise.
    pub const THICK: u32 = 8;
    pub const UNLIT: u32 = 16;
    pub const BASE_COLOR_TEXTURE: u32 = 32;
    pub const EMISSIVE_TEXTURE: u32 = 64;
    pub const NORMAL_MAP: u32 = 128;
    pub const CLEARCOAT_NORMAL_MAP: u32 = 256;

    /// Of [`TextureInfo::flags`]: filtered linearly, on the second set of coordinates, sRGB-encoded.
    pub const TEXTURE_LINEAR: u32 = 1;
    pub const TEXTURE_SECOND_UVS: u32 = 2;
    pub const TEXTURE_SRGB: u32 = 64;
    pub const WRAP_U_SHIFT: u32 = 2;
    pub const WRAP_V_SHIFT: u32 = 4;
    pub const ROLE_SHIFT: u32 = 8;

    /// Modes of wrapping.
    pub const WRAP_REPEAT: u32 = 0;
    pub const WRAP_MIRROR: u32 = 1;
    pub const WRAP_CLAMP: u32 = 2;

    /// Edge of a page of texels.
    pub const PAGE: u32 = 2048;

    /// Of [`Light::kind`].
    pub const LIGHT_SPOT: u32 = 1;
    pub const LIGHT_TRIANGLE: u32 = 2;

    /// In the place of a light's number.
    pub const NO_LIGHT: u32 = u32::MAX;

    /// In a node of the light tree, beside the number of what comes next: a light instead of nodes; the opposite directions
    /// are lit as well.
    pub const LIGHT_LEAF: u32 = 1 << 31;
    pub const LIGHT_TWO_SIDED: u32 = 1 << 30;

    /// Deepest light tree: a trail has a bit per level.
    pub const LIGHT_LEVELS: u32 = 32;

    /// Rows of tables in a row of the texture that has them.
    pub const TABLE_WIDTH: u32 = 8192;

    /// Rows that a node of the triangles' trees takes, and an instance; of the latter, those before the matrix into its
    /// space, before its numbers and before where it was.
    const ROWS_PER_NODE: u32 = (size_of::<Node>() / ROW_BYTES) as u32;
    const ROWS_PER_INSTANCE: u32 = (size_of::<Instance>() / ROW_BYTES) as u32;
    const LOCAL_FROM_WORLD: u32 = (offset_of!(Instance, local_from_world) / ROW_BYTES) as u32;
    const INSTANCE_HEADER: u32 = (offset_of!(Instance, first_prim) / ROW_BYTES) as u32;
    const LAST_WORLD_FROM_LOCAL: u32 = (offset_of!(Instance, last_world_from_local) / ROW_BYTES) as u32;

    /// Nodes of the albedo table along the cosine and along perceptual roughness, both from 0 to 1.
    pub const ALBEDO_GRID: u32 = 32;

    /// Most levels of all trees that a ray goes through.
    const STACK_SIZE: u32 = MAX_DEPTH as u32;
}

/// Microfacets smoother than this are a mirror; the square of perceptual roughness.
pub const SMOOTH: f32 = 1e-4;

pub(super) const ROLES: &[Constant] = &[
    ("ROLE_BASE_COLOR", TextureRole::BaseColor as u32),
    ("ROLE_EMISSIVE", TextureRole::Emissive as u32),
    ("ROLE_METALLIC_ROUGHNESS", TextureRole::MetallicRoughness as u32),
    ("ROLE_NORMAL", TextureRole::Normal as u32),
    ("ROLE_SPECULAR", TextureRole::Specular as u32),
    ("ROLE_SPECULAR_COLOR", TextureRole::SpecularColor as u32),
    ("ROLE_TRANSMISSION", TextureRole::Transmission as u32),
    ("ROLE_CLEARCOAT", TextureRole::Clearcoat as u32),
    ("ROLE_CLEARCOAT_ROUGHNESS", TextureRole::ClearcoatRoughness as u32),
    ("ROLE_CLEARCOAT_NORMAL", TextureRole::ClearcoatNormal as u32),
];
