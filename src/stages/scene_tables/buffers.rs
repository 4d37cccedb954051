//! The tables of a scene on one device.

use std::borrow::Cow;
use std::sync::Arc;

use wgpu::util::DeviceExt;

use super::{SceneTables, TableError, acceleration, linear_from_srgb};
use crate::accel::Node;
use crate::device::{GpuDevice, Traversal};
use crate::image::{Extent, RgbImage};
use crate::scene::{Environment, TexelImage};
use crate::stages::albedo_table;
use crate::stages::layout::{NODES_PER_ROW, PAGE, TEXEL_BYTES};

/// A scene's tables on a device; group 0 of the tracing stages, but for the frame's constants at binding 0.
pub struct SceneBuffers {
    buffers: Vec<(u32, wgpu::Buffer)>,
    tree: wgpu::TextureView,
    texels: wgpu::TextureView,
    environment: wgpu::TextureView,
    /// For hardware traversal.
    tlas: Option<wgpu::Tlas>,
}

/// Binding of the triangles.
const TRIANGLES: u32 = 2;

/// Bindings 1 to 14, and 15 for hardware traversal.
pub fn layout_entries(traversal: Traversal) -> Vec<wgpu::BindGroupLayoutEntry> {
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
    if traversal == Traversal::Hardware {
        entries.push(entry(15, wgpu::BindingType::AccelerationStructure { vertex_return: false }));
    }
    entries
}

impl SceneBuffers {
    pub fn new(gpu: &GpuDevice, tables: &SceneTables) -> Result<Self, TableError> {
        let srgb: Vec<f32> = (0..=255).map(linear_from_srgb).collect();
        let albedo = albedo_table::table();
        let emitters = &tables.emitters;
        let contents = [
            (TRIANGLES, "triangles", bytes_of(&tables.accel.triangles)),
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
        let is_hardware = gpu.info.traversal == Traversal::Hardware;
        let (mut buffers, mut tlas) = (Vec::new(), None);
        for (binding, what, bytes) in contents {
            if bytes.len() as u64 > limit {
                let (mib, limit) = (bytes.len() as u64 >> 20, limit >> 20);
                return Err(TableError::TooLarge { what, mib, limit, device: gpu.info.index });
            }
            let is_built_from = is_hardware && binding == TRIANGLES;
            let more = if is_built_from { wgpu::BufferUsages::BLAS_INPUT } else { wgpu::BufferUsages::empty() };
            let usage = wgpu::BufferUsages::STORAGE | more;
            let descriptor = wgpu::util::BufferInitDescriptor { label: Some(what), contents: &bytes, usage };
            let buffer = gpu.device.create_buffer_init(&descriptor);
            if is_built_from {
                tlas = Some(acceleration::build(gpu, &tables.accel, &buffer)?);
            }
            buffers.push((binding, buffer));
        }
        let tree = upload_tree(gpu, &tables.accel.nodes)?;
        let texels = upload_pages(gpu, &tables.images);
        let environment = upload_environment(gpu, &tables.environment)?;
        gpu.queue.submit([]);
        Ok(Self { buffers, tree, texels, environment, tlas })
    }

    pub fn entries(&self) -> Vec<wgpu::BindGroupEntry<'_>> {
        let buffers = self
            .buffers
            .iter()
            .map(|(binding, b)| wgpu::BindGroupEntry { binding: *binding, resource: b.as_entire_binding() });
        let view = |binding, v| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(v) };
        let views = [view(1, &self.tree), view(7, &self.texels), view(10, &self.environment)];
        let resource = |tlas| wgpu::BindingResource::AccelerationStructure(tlas);
        let tlas = self.tlas.iter().map(|tlas| wgpu::BindGroupEntry { binding: 15, resource: resource(tlas) });
        buffers.chain(views).chain(tlas).collect()
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
