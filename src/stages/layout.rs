//! What shaders and host share, byte for byte. A test checks every struct against the shaders by reflection.

use bytemuck::{Pod, Zeroable};
use glam::{UVec2, Vec2, Vec3, Vec4};

use crate::scene::rig;

/// An eye; `View` in `frame.inc.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct View {
    pub origin: Vec3,
    pub tan_half_x: f32,
    pub right: Vec3,
    pub tan_half_y: f32,
    pub up: Vec3,
    pub pad0: u32,
    pub forward: Vec3,
    pub pad1: u32,
}

impl View {
    pub fn new(view: &rig::View, aspect: f64) -> Self {
        Self {
            origin: view.origin,
            tan_half_x: (f64::from(view.tan_half_yfov) * aspect) as f32,
            right: view.right,
            tan_half_y: view.tan_half_yfov,
            up: view.up,
            pad0: 0,
            forward: view.forward,
            pad1: 0,
        }
    }
}

/// Constants of a frame; `Frame` in `frame.inc.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Frame {
    pub views: [View; 2],
    pub width: u32,
    pub height: u32,
    pub index: u32,
    pub seed: u32,
    pub spp: u32,
    pub reflections: u32,
    pub indirect_clamp: f32,
    pub exposure: f32,
    pub sphere_tree: u32,
    pub light_groups: u32,
    pub env_width: u32,
    pub env_height: u32,
    pub env_radiance: Vec3,
    pub env_rotation: f32,
    pub sphere_tree_end: u32,
    pub light_tree: u32,
    pub local_lights: u32,
    pub directional_lights: u32,
    pub env_grid_width: u32,
    pub env_grid_height: u32,
    pub sample_base: u32,
    pub instances: u32,
    pub world_origin: Vec3,
    pub instance_tree: u32,
    pub instance_count: u32,
    pub curve_shift: u32,
    pub history_rows: u32,
    pub mask_turn: u32,
    pub centre: Vec2,
    pub fovea_radii: Vec2,
    pub gaze: Vec4,
    pub layer_iterations: [u32; 3],
    pub unsampled_share: f32,
    pub sampled_share: f32,
    pub pad: [u32; 3],
}

/// Of [`Frame::curve_shift`]: each pixel has sequences of its own.
pub const NO_CURVE: u32 = 32;

/// Of [`Frame::history_rows`]: the frame knows nothing of the one before.
pub const NO_HISTORY: u32 = u32::MAX;

/// Constants of a dispatch; `Pass` in `frame.inc.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct PassConstants {
    pub view: u32,
    pub row_begin: u32,
    pub row_end: u32,
    pub valid_begin: u32,
    pub valid_end: u32,
    pub args: [u32; 3],
    /// Of the pass's grid.
    pub width: u32,
    pub height: u32,
    pub device: u32,
}

/// `Material` in `scene.inc.wgsl`. Its textures stand one after another in the texture table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Material {
    pub base_color: Vec4,
    pub emissive: Vec3,
    pub pad0: u32,
    pub roughness: f32,
    pub metallic: f32,
    pub alpha_cutoff: f32,
    pub flags: u32,
    pub ior: f32,
    pub specular: f32,
    pub transmission: f32,
    pub clearcoat: f32,
    pub specular_color: Vec3,
    pub clearcoat_roughness: f32,
    pub absorption: Vec3,
    pub normal_scale: f32,
    pub clearcoat_normal_scale: f32,
    pub first_texture: u32,
    pub texture_count: u32,
    pub pad: u32,
}

pub const DOUBLE_SIDED: u32 = 1;
pub const ALPHA_MASK: u32 = 2;
pub const ALPHA_BLEND: u32 = 4;
pub const THICK: u32 = 8;
pub const UNLIT: u32 = 16;
pub const BASE_COLOR_TEXTURE: u32 = 32;
pub const EMISSIVE_TEXTURE: u32 = 64;
pub const NORMAL_MAP: u32 = 128;
pub const CLEARCOAT_NORMAL_MAP: u32 = 256;

/// What a material's texture is for; bits 8 to 11 of [`TextureInfo::flags`].
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
    /// Whether it holds colours, sRGB-encoded; bit 6 of [`TextureInfo::flags`].
    pub fn is_color(self) -> bool {
        matches!(self, Self::BaseColor | Self::Emissive | Self::SpecularColor)
    }
}

/// `TextureInfo` in `scene.inc.wgsl`: a texture as one material refers to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TextureInfo {
    pub first: u32,
    pub width: u32,
    pub height: u32,
    /// Bit 0: bilinear. Bit 1: coordinate set 1. Bits 2, 3: wrap of u. Bits 4, 5: wrap of v (0 repeat, 1 mirror, 2 clamp).
    /// Bit 6: colours. Bits 8 to 11: [`TextureRole`].
    pub flags: u32,
    pub uv_matrix: Vec4,
    pub uv_offset: Vec2,
    pub pad: UVec2,
}

/// `Light` in `lights.inc.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Light {
    pub position: Vec3,
    pub kind: u32,
    pub strength: Vec3,
    pub radius: f32,
    pub axis: Vec3,
    pub cos_outer: f32,
    pub cone_scale: f32,
    pub pick: f32,
    pub keep: f32,
    pub alias: u32,
    pub prim: u32,
    pub trail: u32,
    pub pad: [u32; 2],
}

pub const LIGHT_SPOT: u32 = 1;
pub const LIGHT_TRIANGLE: u32 = 2;

/// `EnvCell` in `environment.inc.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct EnvCell {
    pub keep: f32,
    pub alias: u32,
    pub density: f32,
}
