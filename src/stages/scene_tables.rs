//! The scene as the tracing stages read it: tables made once per scene, and their copy on a device.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{DVec3, Vec3, Vec4};
use wgpu::util::DeviceExt;

use super::albedo_table;
use super::emitters::{self, Emitters};
use super::layout::{
    self, ALPHA_BLEND, ALPHA_MASK, BASE_COLOR_TEXTURE, CLEARCOAT_NORMAL_MAP, DOUBLE_SIDED, EMISSIVE_TEXTURE,
    NODES_PER_ROW, NORMAL_MAP, PAGE, ROLE_SHIFT, TEXEL_BYTES, TEXTURE_LINEAR, TEXTURE_SECOND_UVS, TEXTURE_SRGB, THICK,
    TextureInfo, TextureRole, UNLIT, WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT, WRAP_U_SHIFT, WRAP_V_SHIFT,
};
use crate::accel::{Accel, Node};
use crate::device::GpuDevice;
use crate::image::{Extent, RgbImage};
use crate::scene::budget::{Budget, Exceeded};
use crate::scene::{self, AlphaMode, Environment, Scene, TexelImage, Wrap};

#[derive(Debug, thiserror::Error)]
pub enum TableError {
    #[error(
        "the scene's {what} take {mib} MiB, more than the {limit} MiB that device {device} lets a shader read at once"
    )]
    TooLarge { what: &'static str, mib: u64, limit: u64, device: usize },
    #[error("the tables of the scene's lights are refused: {0}")]
    Memory(Exceeded),
    #[error("the scene's textures hold {0} texels, more than the 2^32 that can be addressed: make them smaller")]
    Texels(u64),
    #[error("the environment image is {0}; the device takes {1} pixels an edge at most: make it smaller")]
    Environment(Extent, u32),
}

/// Tables of one scene, the same for every device.
pub struct SceneTables {
    accel: Accel,
    /// First row of the instances in the table of nodes.
    instances: u32,
    has_surfaces: bool,
    materials: Vec<layout::Material>,
    textures: Vec<TextureInfo>,
    images: Vec<Arc<TexelImage>>,
    emitters: Emitters,
    environment: Environment,
}

/// The sRGB decoding of IEC 61966-2-1 for an 8-bit code.
pub(super) fn linear_from_srgb(code: u8) -> f32 {
    let c = f64::from(code) / 255.0;
    (if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }) as f32
}

impl SceneTables {
    /// # Errors
    /// If the scene's textures cannot be addressed.
    pub fn new(scene: &Scene, accel: Accel) -> Result<Self, TableError> {
        Self::within(scene, accel, &Budget::unlimited())
    }

    /// # Errors
    /// As [`Self::new`], and if the budget has no room for them.
    pub fn within(scene: &Scene, mut accel: Accel, budget: &Budget) -> Result<Self, TableError> {
        let _reserved = budget.reserve(emitters::making_bytes(scene, &accel)).map_err(TableError::Memory)?;
        let has_surfaces = accel.nodes.len() > 1 || accel.nodes[0] != [0; 20];
        let emitters = Emitters::new(scene, &mut accel);
        let instances = emitters::rows(&accel.nodes);
        emitters::append(&mut accel.nodes, bytemuck::cast_slice(&accel.instances));
        let mut firsts = Vec::with_capacity(scene.images.len());
        let mut texels = 0;
        for image in &scene.images {
            firsts.push(texels);
            texels += image.pixels.len() as u64;
        }
        if texels > u64::from(u32::MAX) {
            return Err(TableError::Texels(texels));
        }
        let firsts = firsts.into_iter().map(|first| first as u32).collect();
        let mut table = TextureTable { scene, firsts, infos: Vec::new() };
        let materials: Vec<_> = scene.materials.iter().map(|m| table.material(m)).collect();
        let textures = table.infos;
        let (images, environment) = (scene.images.clone(), scene.environment.clone());
        Ok(Self { accel, instances, has_surfaces, materials, textures, images, emitters, environment })
    }

    /// Fills in what the scene says about a frame.
    pub fn describe(&self, frame: &mut layout::Frame) {
        frame.geometry = layout::Geometry {
            world_origin: self.accel.origin.as_vec3(),
            instance_tree: self.accel.instance_tree,
            instances: self.instances,
            instance_count: self.accel.instances.len() as u32,
            ..Default::default()
        };
        frame.lights = self.emitters.describe();
        frame.environment = self.describe_environment();
    }

    fn describe_environment(&self) -> layout::Environment {
        let [grid_width, grid_height] = self.emitters.env_size;
        let grid = layout::Environment { grid_width, grid_height, ..Default::default() };
        match &self.environment {
            Environment::Black => grid,
            Environment::Constant(radiance) => layout::Environment { radiance: *radiance, ..grid },
            Environment::Map { image, rotation_deg } => {
                let Extent { width, height } = image.extent;
                layout::Environment { rotation: rotation_deg / 360.0, width, height, ..grid }
            }
        }
    }

    /// Where the tables' (0, 0, 0) is in the world.
    pub fn origin(&self) -> DVec3 {
        self.accel.origin
    }

    /// At most the distance to the nearest triangle from a point relative to [`Self::origin`].
    pub fn clearance(&self, point: Vec3) -> f32 {
        self.accel.clearance(point)
    }

    /// Whether rays meet some triangles by way of their instances.
    pub fn has_instances(&self) -> bool {
        self.accel.instances.len() > 1
    }

    /// Whether there is anything that could reflect light.
    pub fn has_surfaces(&self) -> bool {
        self.has_surfaces
    }
}

/// The texture table: each material's textures, one after another.
struct TextureTable<'a> {
    scene: &'a Scene,
    /// First texel of each image.
    firsts: Vec<u32>,
    infos: Vec<TextureInfo>,
}

impl TextureTable<'_> {
    fn info(&self, r: &scene::TextureRef, role: TextureRole) -> TextureInfo {
        let wrap = |w| match w {
            Wrap::Repeat => WRAP_REPEAT,
            Wrap::MirroredRepeat => WRAP_MIRROR,
            Wrap::ClampToEdge => WRAP_CLAMP,
        };
        let texture = &self.scene.textures[r.texture];
        let Extent { width, height } = self.scene.images[texture.image].extent;
        let wraps = wrap(texture.wrap_u) << WRAP_U_SHIFT | wrap(texture.wrap_v) << WRAP_V_SHIFT;
        let flags =
            [(texture.linear, TEXTURE_LINEAR), (r.uv_set == 1, TEXTURE_SECOND_UVS), (role.is_color(), TEXTURE_SRGB)];
        let m = r.uv_from_uv.matrix2;
        TextureInfo {
            first: self.firsts[texture.image],
            width,
            height,
            flags: all_set(&flags) | wraps | (role as u32) << ROLE_SHIFT,
            uv_matrix: Vec4::new(m.x_axis.x, m.y_axis.x, m.x_axis.y, m.y_axis.y),
            uv_offset: r.uv_from_uv.translation,
            ..Default::default()
        }
    }

    fn material(&mut self, m: &scene::Material) -> layout::Material {
        let (alpha, alpha_cutoff) = match m.alpha_mode {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask { cutoff } => (ALPHA_MASK, cutoff),
            AlphaMode::Blend => (ALPHA_BLEND, 0.0),
        };
        let flags = [
            (m.double_sided, DOUBLE_SIDED),
            (m.volume.is_some(), THICK),
            (m.unlit, UNLIT),
            (m.base_color_texture.is_some(), BASE_COLOR_TEXTURE),
            (m.emissive_texture.is_some(), EMISSIVE_TEXTURE),
            (m.normal_map.is_some(), NORMAL_MAP),
            (m.clearcoat.normal_map.is_some(), CLEARCOAT_NORMAL_MAP),
        ];
        let first_texture = self.infos.len() as u32;
        for (texture, role) in textures_in_order(m) {
            self.infos.push(self.info(&texture, role));
        }
        let scale = |map: Option<scene::NormalMap>| map.map_or(1.0, |map| map.scale);
        layout::Material {
            base_color: m.base_color,
            emissive: m.emissive,
            roughness: m.roughness,
            metallic: m.metallic,
            alpha_cutoff,
            flags: alpha | all_set(&flags),
            ior: m.ior,
            specular: m.specular,
            transmission: m.transmission,
            clearcoat: m.clearcoat.factor,
            specular_color: m.specular_color,
            clearcoat_roughness: m.clearcoat.roughness,
            absorption: m.volume.map_or(Vec3::ZERO, absorption),
            normal_scale: scale(m.normal_map),
            clearcoat_normal_scale: scale(m.clearcoat.normal_map),
            first_texture,
            texture_count: self.infos.len() as u32 - first_texture,
            ..Default::default()
        }
    }
}

/// The bits that are set.
fn all_set(flags: &[(bool, u32)]) -> u32 {
    flags.iter().filter(|(is_set, _)| *is_set).fold(0, |all, (_, bit)| all | bit)
}

/// Base colour and emission come first: shaders look for them alone, too.
fn textures_in_order(m: &scene::Material) -> impl Iterator<Item = (scene::TextureRef, TextureRole)> {
    use TextureRole::*;
    let map = |map: Option<scene::NormalMap>| map.map(|map| map.texture);
    let all = [
        (m.base_color_texture, BaseColor),
        (m.emissive_texture, Emissive),
        (m.metallic_roughness_texture, MetallicRoughness),
        (map(m.normal_map), Normal),
        (m.specular_texture, Specular),
        (m.specular_color_texture, SpecularColor),
        (m.transmission_texture, Transmission),
        (m.clearcoat.factor_texture, Clearcoat),
        (m.clearcoat.roughness_texture, ClearcoatRoughness),
        (map(m.clearcoat.normal_map), ClearcoatNormal),
    ];
    all.into_iter().filter_map(|(texture, role)| Some((texture?, role)))
}

/// Absorption coefficient, one over scene units: Beer and Lambert's law solved for `KHR_materials_volume`'s terms. A colour of
/// 0 is kept just above it, so that the coefficient stays finite.
fn absorption(volume: scene::Volume) -> Vec3 {
    let color = volume.attenuation_color.clamp(Vec3::splat(1e-30), Vec3::ONE);
    -color.map(f32::ln) / volume.attenuation_distance.max(1e-30)
}

/// A scene's tables on a device; group 0 of the tracing stages, but for the frame's constants at binding 0.
pub struct SceneBuffers {
    buffers: Vec<(u32, wgpu::Buffer)>,
    tree: wgpu::TextureView,
    texels: wgpu::TextureView,
    environment: wgpu::TextureView,
}

/// Bindings 1 to 14.
pub fn layout_entries() -> Vec<wgpu::BindGroupLayoutEntry> {
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None };
    let storage = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only: true },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let texture =
        |sample_type, view_dimension| wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false };
    let float = wgpu::TextureSampleType::Float { filterable: false };
    let mut entries: Vec<_> = [2, 3, 4, 5, 6, 8, 9, 11, 12, 13, 14].map(|b| entry(b, storage)).into();
    entries.push(entry(1, texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2)));
    entries.push(entry(7, texture(float, wgpu::TextureViewDimension::D2Array)));
    entries.push(entry(10, texture(float, wgpu::TextureViewDimension::D2)));
    entries
}

impl SceneBuffers {
    pub fn new(gpu: &GpuDevice, tables: &SceneTables) -> Result<Self, TableError> {
        let srgb: Vec<f32> = (0..=255).map(linear_from_srgb).collect();
        let albedo = albedo_table::table();
        let emitters = &tables.emitters;
        let contents = [
            (2, "triangles", bytes_of(&tables.accel.triangles)),
            (3, "normals and texture coordinates", bytes_of(&tables.accel.shadings)),
            (4, "vertex colours", bytes_of(&tables.accel.colors)),
            (5, "materials", bytes_of(&tables.materials)),
            (6, "texture table", bytes_of(&tables.textures)),
            (8, "sRGB table", bytes_of(&srgb)),
            (9, "lights", bytes_of(&emitters.lights)),
            (11, "environment grid", bytes_of(&emitters.env_cells)),
            (12, "second texture coordinates", bytes_of(&tables.accel.second_uvs)),
            (13, "tangents", bytes_of(&tables.accel.tangents)),
            (14, "albedo table", bytes_of(&albedo)),
        ];
        let limit = gpu.info.max_storage_bytes;
        let mut buffers = Vec::new();
        for (binding, what, bytes) in contents {
            if bytes.len() as u64 > limit {
                let (mib, limit) = (bytes.len() as u64 >> 20, limit >> 20);
                return Err(TableError::TooLarge { what, mib, limit, device: gpu.info.index });
            }
            let descriptor = wgpu::util::BufferInitDescriptor {
                label: Some(what),
                contents: &bytes,
                usage: wgpu::BufferUsages::STORAGE,
            };
            buffers.push((binding, gpu.device.create_buffer_init(&descriptor)));
        }
        let tree = upload_tree(gpu, &tables.accel.nodes)?;
        let texels = upload_pages(gpu, &tables.images);
        let environment = upload_environment(gpu, &tables.environment)?;
        gpu.queue.submit([]);
        Ok(Self { buffers, tree, texels, environment })
    }

    pub fn entries(&self) -> Vec<wgpu::BindGroupEntry<'_>> {
        let buffers = self
            .buffers
            .iter()
            .map(|(binding, b)| wgpu::BindGroupEntry { binding: *binding, resource: b.as_entire_binding() });
        let view = |binding, v| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(v) };
        buffers.chain([view(1, &self.tree), view(7, &self.texels), view(10, &self.environment)]).collect()
    }
}

/// A table's bytes. No binding may be empty: a table without entries becomes one zeroed entry.
fn bytes_of<T: bytemuck::Pod>(table: &[T]) -> Cow<'_, [u8]> {
    if table.is_empty() { Cow::Owned(vec![0; size_of::<T>()]) } else { Cow::Borrowed(bytemuck::cast_slice(table)) }
}

/// Nodes row after row.
fn upload_tree(gpu: &GpuDevice, nodes: &[Node]) -> Result<wgpu::TextureView, TableError> {
    let row_bytes = NODES_PER_ROW as usize * size_of::<Node>();
    let rows = nodes.len().div_ceil(NODES_PER_ROW as usize);
    let max_rows = gpu.device.limits().max_texture_dimension_2d as usize;
    if rows > max_rows {
        let [mib, limit] = [rows, max_rows].map(|r| (r * row_bytes) as u64 >> 20);
        return Err(TableError::TooLarge { what: "tree", mib, limit, device: gpu.info.index });
    }
    let (width, height) = (row_bytes as u32 / TEXEL_BYTES, rows as u32);
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = new_texture(gpu, "tree", size, wgpu::TextureFormat::Rgba32Uint);
    let mut bytes: Vec<u8> = bytemuck::cast_slice(nodes).to_vec();
    bytes.resize(rows * row_bytes, 0);
    write_layer(gpu, &texture, 0, [width, height], TEXEL_BYTES, &bytes);
    Ok(texture.create_view(&Default::default()))
}

/// The images' texels, one after another.
fn upload_pages(gpu: &GpuDevice, images: &[Arc<TexelImage>]) -> wgpu::TextureView {
    let texels: usize = images.iter().map(|image| image.pixels.len()).sum();
    let edge = if texels == 0 { 1 } else { PAGE };
    let per_page = (edge * edge) as usize;
    let pages = texels.div_ceil(per_page).max(1) as u32;
    let size = wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: pages };
    let texture = new_texture(gpu, "texels", size, wgpu::TextureFormat::Rgba8Unorm);
    let mut rest = images.iter().flat_map(|image| &image.pixels).copied();
    for z in 0..pages {
        let mut page: Vec<[u8; 4]> = rest.by_ref().take(per_page).collect();
        page.resize(per_page, [0; 4]);
        write_layer(gpu, &texture, z, [edge, edge], 4, bytemuck::cast_slice(&page));
        // Else all pages wait in memory for one submission.
        gpu.queue.submit([]);
    }
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

fn upload_environment(gpu: &GpuDevice, environment: &Environment) -> Result<wgpu::TextureView, TableError> {
    let black = RgbImage::filled(Extent::new(1, 1), [0.0; 3]);
    let image = if let Environment::Map { image, .. } = environment { image } else { &black };
    let Extent { width, height } = image.extent;
    let limit = gpu.device.limits().max_texture_dimension_2d;
    if width.max(height) > limit {
        return Err(TableError::Environment(image.extent, limit));
    }
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = new_texture(gpu, "environment", size, wgpu::TextureFormat::Rgba32Float);
    let rgba: Vec<[f32; 4]> = image.pixels.iter().map(|p| [p[0], p[1], p[2], 1.0]).collect();
    write_layer(gpu, &texture, 0, [width, height], 16, bytemuck::cast_slice(&rgba));
    Ok(texture.create_view(&Default::default()))
}

fn new_texture(gpu: &GpuDevice, label: &str, size: wgpu::Extent3d, format: wgpu::TextureFormat) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn write_layer(gpu: &GpuDevice, texture: &wgpu::Texture, z: u32, size: [u32; 2], texel_bytes: u32, bytes: &[u8]) {
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x: 0, y: 0, z },
            aspect: wgpu::TextureAspect::All,
        },
        bytes,
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(size[0] * texel_bytes), rows_per_image: None },
        wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
    );
}
