//! The tables of a scene on one device.

use std::borrow::Cow;
use std::sync::Arc;

use super::{SceneTables, acceleration, linear_from_srgb};
use crate::accel::Node;
use crate::device::{GpuDevice, Nodes, SceneAccess, Traversal};
use crate::image::{Extent, RgbImage};
use crate::scene::{Environment, TexelImage};
use crate::stages::albedo_table;
use crate::stages::layout::TEXEL_BYTES;
use crate::stages::limits::{self, LimitExceeded, Pages, SceneSizes, tree_size};

/// A scene's tables on a device; group 0 of the tracing stages, but for the frame's constants at binding 0.
pub struct SceneBuffers {
    buffers: Vec<(u32, wgpu::Buffer)>,
    textures: Vec<(u32, wgpu::TextureView)>,
    /// For hardware traversal.
    tlas: Option<wgpu::Tlas>,
}

/// Storage buffers among them, beside that of the trees' nodes.
const SCENE_BUFFERS: usize = 11;

/// How many storage buffers a pass binds that reads the scene.
pub fn scene_buffers(nodes: Nodes) -> usize {
    SCENE_BUFFERS + usize::from(nodes == Nodes::Buffer)
}

/// Binding of the triangles.
const TRIANGLES: u32 = 2;

/// Bindings 1 to 14, and 15 for hardware traversal.
pub fn layout_entries(SceneAccess { nodes, traversal }: SceneAccess) -> Vec<wgpu::BindGroupLayoutEntry> {
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
    let buffers: [u32; SCENE_BUFFERS] = [2, 3, 4, 5, 6, 8, 9, 11, 12, 13, 14];
    let mut entries: Vec<_> = buffers.map(|b| entry(b, storage)).into();
    entries.push(match nodes {
        Nodes::Buffer => entry(1, storage),
        Nodes::Texture => entry(1, texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2)),
    });
    entries.push(entry(7, texture(float, wgpu::TextureViewDimension::D2Array)));
    entries.push(entry(10, texture(float, wgpu::TextureViewDimension::D2)));
    if traversal == Traversal::Hardware {
        entries.push(entry(15, wgpu::BindingType::AccelerationStructure { vertex_return: false }));
    }
    entries
}

impl SceneBuffers {
    /// # Errors
    /// A scene that is beyond the limits of the device.
    pub fn new(gpu: &GpuDevice, tables: &SceneTables) -> Result<Self, LimitExceeded> {
        let srgb: Vec<f32> = (0..=255).map(linear_from_srgb).collect();
        let albedo = albedo_table::table();
        let emitters = &tables.emitters;
        let mut contents = vec![
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
        let nodes = &tables.accel.nodes;
        let SceneAccess { nodes: read_from, traversal } = gpu.scene_access();
        let is_textured = read_from == Nodes::Texture;
        if !is_textured {
            contents.push((1, "tree", bytes_of(nodes)));
        }
        let environment = environment_image(&tables.environment);
        let sizes = SceneSizes {
            buffers: contents.iter().map(|(_, what, bytes)| (*what, bytes.len() as u64)).collect(),
            textured_nodes: if is_textured { nodes.len() } else { 0 },
            texels: tables.images.iter().map(|image| image.pixels.len()).sum(),
            environment: environment.extent,
        };
        limits::check(&gpu.device.limits(), gpu.info.index, limits::of_scene(&sizes))?;
        let (mut buffers, mut tlas) = (Vec::new(), None);
        for (binding, what, bytes) in &contents {
            let is_built_from = traversal == Traversal::Hardware && *binding == TRIANGLES;
            let more = if is_built_from { wgpu::BufferUsages::BLAS_INPUT } else { wgpu::BufferUsages::empty() };
            let buffer = upload(gpu, what, bytes, more);
            if is_built_from {
                tlas = Some(acceleration::build(gpu, &tables.accel, &buffer)?);
            }
            buffers.push((*binding, buffer));
        }
        let mut textures = vec![
            (7, upload_pages(gpu, &tables.images, &Pages::of(sizes.texels))),
            (10, upload_environment(gpu, &environment)),
        ];
        textures.extend(is_textured.then(|| (1, upload_tree(gpu, nodes))));
        Ok(Self { buffers, textures, tlas })
    }

    pub fn entries(&self) -> Vec<wgpu::BindGroupEntry<'_>> {
        let buffers = self.buffers.iter().map(|(binding, b)| (*binding, b.as_entire_binding()));
        let textures = self.textures.iter().map(|(binding, v)| (*binding, wgpu::BindingResource::TextureView(v)));
        let tlas = self.tlas.iter().map(|tlas| (15, wgpu::BindingResource::AccelerationStructure(tlas)));
        let all = buffers.chain(textures).chain(tlas);
        all.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect()
    }
}

/// A table's bytes. No binding may be empty: a table without entries becomes one zeroed entry.
fn bytes_of<T: bytemuck::Pod>(table: &[T]) -> Cow<'_, [u8]> {
    if table.is_empty() { Cow::Owned(vec![0; size_of::<T>()]) } else { Cow::Borrowed(bytemuck::cast_slice(table)) }
}

/// A buffer with these contents, unless the device has failed.
fn upload(gpu: &GpuDevice, label: &str, contents: &[u8], more: wgpu::BufferUsages) -> wgpu::Buffer {
    let size = (contents.len() as u64).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
    let usage = wgpu::BufferUsages::STORAGE | more;
    let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: true };
    let buffer = gpu.device.create_buffer(&descriptor);
    if let Ok(mut mapped) = buffer.get_mapped_range_mut(..) {
        mapped.slice(..contents.len()).copy_from_slice(contents);
    }
    buffer.unmap();
    buffer
}

/// Nodes row after row.
fn upload_tree(gpu: &GpuDevice, nodes: &[Node]) -> wgpu::TextureView {
    let [width, height] = tree_size(nodes.len());
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = new_texture(gpu, "tree", size, wgpu::TextureFormat::Rgba32Uint);
    let mut bytes: Vec<u8> = bytemuck::cast_slice(nodes).to_vec();
    bytes.resize((width * TEXEL_BYTES) as usize * height as usize, 0);
    write_layer(gpu, &texture, 0, width, TEXEL_BYTES, &bytes);
    texture.create_view(&Default::default())
}

/// The images' texels, one after another.
fn upload_pages(gpu: &GpuDevice, images: &[Arc<TexelImage>], &Pages { edge, count }: &Pages) -> wgpu::TextureView {
    let per_page = (edge * edge) as usize;
    let pages = count as u32;
    let size = wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: pages };
    let texture = new_texture(gpu, "texels", size, wgpu::TextureFormat::Rgba8Unorm);
    let mut rest = images.iter().flat_map(|image| &image.pixels).copied();
    for z in 0..pages {
        let mut page: Vec<[u8; 4]> = rest.by_ref().take(per_page).collect();
        page.resize(per_page, [0; 4]);
        write_layer(gpu, &texture, z, edge, 4, bytemuck::cast_slice(&page));
    }
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// One black pixel where there is none.
fn environment_image(environment: &Environment) -> Cow<'_, RgbImage> {
    match environment {
        Environment::Map { image, .. } => Cow::Borrowed(image),
        _ => Cow::Owned(RgbImage::filled(Extent::new(1, 1), [0.0; 3])),
    }
}

fn upload_environment(gpu: &GpuDevice, image: &RgbImage) -> wgpu::TextureView {
    let Extent { width, height } = image.extent;
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = new_texture(gpu, "environment", size, wgpu::TextureFormat::Rgba32Float);
    let rgba: Vec<[f32; 4]> = image.pixels.iter().map(|p| [p[0], p[1], p[2], 1.0]).collect();
    write_layer(gpu, &texture, 0, width, 16, bytemuck::cast_slice(&rgba));
    texture.create_view(&Default::default())
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

/// Bytes that wait in memory for one submission.
const UPLOAD_BYTES: usize = 64 << 20;

/// Row after row, a bounded number of them at a time: all that is written waits in one buffer for its submission.
fn write_layer(gpu: &GpuDevice, texture: &wgpu::Texture, z: u32, width: u32, texel_bytes: u32, bytes: &[u8]) {
    let row_bytes = (width * texel_bytes) as usize;
    let rows = (UPLOAD_BYTES / row_bytes).max(1);
    for (i, part) in bytes.chunks(rows * row_bytes).enumerate() {
        let height = (part.len() / row_bytes) as u32;
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x: 0, y: (i * rows) as u32, z },
                aspect: wgpu::TextureAspect::All,
            },
            part,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * texel_bytes), rows_per_image: None },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        gpu.queue.submit([]);
    }
}
