//! The tables of a scene on one device.

use std::borrow::Cow;
use std::sync::Arc;

use super::acceleration::Structures;
use super::{SceneTables, SceneUpdate};
use crate::device::{GpuDevice, SceneAccess, Tables, Traversal};
use crate::image::{Extent, RgbImage};
use crate::scene::{Environment, TexelImage};
use crate::tables::limits::{self, LimitExceeded, Pages, SceneSizes, table_size};
use crate::wgsl::ROW_BYTES;

/// A scene's tables on a device: bind group 0 of the tracing stages, except for the frame's constants at binding 0.
pub struct SceneBuffers {
    tables: TableStore,
    textures: Vec<(u32, wgpu::TextureView)>,
    /// Acceleration structures, for hardware traversal.
    structures: Option<Structures>,
}

/// Storage of the tables.
enum TableStore {
    Buffer(wgpu::Buffer),
    Texture(wgpu::Texture, wgpu::TextureView),
}

/// Returns the number of storage buffers that a pass binds to read the scene.
pub fn scene_buffers(tables: Tables) -> usize {
    usize::from(tables == Tables::Buffer)
}

/// Bindings of the tables, the texels of textures, the environment image, and the TLAS for hardware traversal.
const TABLES: u32 = 1;
const TEXELS: u32 = 2;
const ENVIRONMENT: u32 = 3;
const INSTANCES: u32 = 4;

const TABLE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;

fn tables_entry(tables: Tables, read_only: bool) -> wgpu::BindGroupLayoutEntry {
    let ty = match tables {
        Tables::Buffer => wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        Tables::Texture => wgpu::BindingType::StorageTexture {
            access: match read_only {
                true => wgpu::StorageTextureAccess::ReadOnly,
                false => wgpu::StorageTextureAccess::WriteOnly,
            },
            format: TABLE_FORMAT,
            view_dimension: wgpu::TextureViewDimension::D2,
        },
    };
    wgpu::BindGroupLayoutEntry { binding: TABLES, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None }
}

/// Returns the layout entry of passes that write the tables and read nothing of the scene.
pub fn changing_entry(tables: Tables) -> wgpu::BindGroupLayoutEntry {
    tables_entry(tables, false)
}

pub fn layout_entries(SceneAccess { tables, traversal }: SceneAccess) -> Vec<wgpu::BindGroupLayoutEntry> {
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None };
    let texture = |view_dimension| wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: false },
        view_dimension,
        multisampled: false,
    };
    let mut entries = vec![
        tables_entry(tables, true),
        entry(TEXELS, texture(wgpu::TextureViewDimension::D2Array)),
        entry(ENVIRONMENT, texture(wgpu::TextureViewDimension::D2)),
    ];
    if traversal == Traversal::Hardware {
        entries.push(entry(INSTANCES, wgpu::BindingType::AccelerationStructure { vertex_return: false }));
    }
    entries
}

impl SceneBuffers {
    /// Uploads a scene's tables and builds its acceleration structures.
    ///
    /// # Errors
    /// [`LimitExceeded`] if the scene exceeds a limit of the device.
    pub fn new(gpu: &GpuDevice, tables: &SceneTables) -> Result<Self, LimitExceeded> {
        let SceneAccess { tables: read_from, traversal } = gpu.scene_access();
        let parts = tables.in_order().1;
        let bytes: usize = parts.iter().map(|part| part.len()).sum();
        let environment = environment_image(&tables.environment);
        let sizes = SceneSizes {
            rows: (bytes / ROW_BYTES) as u64,
            tables: read_from,
            texels: tables.images.iter().map(|image| image.pixels.len()).sum(),
            environment: environment.extent,
        };
        limits::check(&gpu.device.limits(), gpu.info.index, limits::of_scene(&sizes))?;
        let is_hardware = traversal == Traversal::Hardware;
        let structures = is_hardware.then(|| Structures::new(gpu, &tables.accel, tables.instances)).transpose()?;
        let textures = vec![
            (TEXELS, upload_pages(gpu, &tables.images, &Pages::of(sizes.texels))),
            (ENVIRONMENT, upload_environment(gpu, &environment)),
        ];
        let tables = match read_from {
            Tables::Buffer => TableStore::Buffer(upload(gpu, &parts, bytes)),
            Tables::Texture => {
                let texture = upload_rows(gpu, &parts, sizes.rows);
                let view = texture.create_view(&Default::default());
                TableStore::Texture(texture, view)
            }
        };
        Ok(Self { tables, textures, structures })
    }

    pub fn entries(&self) -> Vec<wgpu::BindGroupEntry<'_>> {
        let textures = self.textures.iter().map(|(binding, v)| (*binding, wgpu::BindingResource::TextureView(v)));
        let top = self.structures.iter().map(|s| (INSTANCES, s.top().as_binding()));
        let others = textures.chain(top).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource });
        std::iter::once(self.tables_entry()).chain(others).collect()
    }

    /// Returns the bind group entry of the tables without those of textures and of the TLAS.
    pub fn tables_entry(&self) -> wgpu::BindGroupEntry<'_> {
        let resource = match &self.tables {
            TableStore::Buffer(buffer) => buffer.as_entire_binding(),
            TableStore::Texture(_, view) => wgpu::BindingResource::TextureView(view),
        };
        wgpu::BindGroupEntry { binding: TABLES, resource }
    }

    /// Uploads the changes of a frame. The device applies them at the start of its next submission.
    /// [`Self::build_structures`] then updates its acceleration structures.
    pub fn update(&mut self, gpu: &GpuDevice, update: &SceneUpdate) {
        for (first_row, rows) in &update.rows {
            self.write(gpu, *first_row, rows);
        }
        if let Some(structures) = &mut self.structures {
            structures.place(update);
        }
    }

    /// Records the builds of dynamic geometry's acceleration structures, if the device has any. `vertices` are the
    /// world-space vertices that the pass `skin` has written.
    pub fn build_structures(&self, encoder: &mut wgpu::CommandEncoder, vertices: &wgpu::Buffer) {
        if let Some(structures) = &self.structures {
            structures.build(encoder, vertices);
        }
    }

    /// Writes rows of the tables from `first` on. The device applies this at the start of its next submission.
    fn write(&self, gpu: &GpuDevice, first: u32, bytes: &[u8]) {
        match &self.tables {
            TableStore::Buffer(buffer) => gpu.queue.write_buffer(buffer, u64::from(first) * ROW_BYTES as u64, bytes),
            TableStore::Texture(texture, _) => write_texels(gpu, texture, first, bytes),
        }
    }
}

/// Creates a buffer that holds `parts`, whose total size is `bytes`.
fn upload(gpu: &GpuDevice, parts: &[Cow<'_, [u8]>], bytes: usize) -> wgpu::Buffer {
    let buffer = gpu.buffer("tables", bytes as u64, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST);
    let mut at = 0;
    for batch in parts.iter().flat_map(|part| part.chunks(UPLOAD_BYTES)) {
        gpu.queue.write_buffer(&buffer, at, batch);
        at += batch.len() as u64;
        finish_batch(gpu);
    }
    buffer
}

/// Uploads the tables to a texture, one texel per table row, in row-major order.
fn upload_rows(gpu: &GpuDevice, parts: &[Cow<'_, [u8]>], rows: u64) -> wgpu::Texture {
    let [width, height] = table_size(rows);
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = new_texture(gpu, "tables", size, TABLE_FORMAT);
    let mut at = 0;
    for batch in parts.iter().flat_map(|part| part.chunks(UPLOAD_BYTES)) {
        write_texels(gpu, &texture, at, batch);
        at += (batch.len() / ROW_BYTES) as u32;
        finish_batch(gpu);
    }
    texture
}

/// Waits until the device has taken what was written, so that it is no longer staged in memory.
fn finish_batch(gpu: &GpuDevice) {
    gpu.queue.submit([]);
    // A device that fails is noticed when it renders.
    let _ = gpu.device.poll(wgpu::PollType::wait_indefinitely());
}

/// Writes consecutive table rows, one texel each, to the texture that stores the tables. A range that begins or ends
/// within a row of the texture is written in up to three parts: rest of the first row, whole rows, start of the last.
fn write_texels(gpu: &GpuDevice, texture: &wgpu::Texture, first: u32, bytes: &[u8]) {
    let width = texture.width();
    let mut at = first;
    let mut rest = bytes;
    while !rest.is_empty() {
        let (x, y) = (at % width, at / width);
        let texels = (rest.len() / ROW_BYTES) as u32;
        let (columns, rows) =
            if x == 0 && texels >= width { (width, texels / width) } else { (texels.min(width - x), 1) };
        let (now, later) = rest.split_at((columns * rows) as usize * ROW_BYTES);
        write_texture(gpu, texture, wgpu::Origin3d { x, y, z: 0 }, [columns, rows], now);
        (at, rest) = (at + columns * rows, later);
    }
}

/// Writes a rectangle of a texture, whose rows follow one another in `bytes`.
fn write_texture(gpu: &GpuDevice, texture: &wgpu::Texture, origin: wgpu::Origin3d, size: [u32; 2], bytes: &[u8]) {
    let [width, height] = size;
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo { texture, mip_level: 0, origin, aspect: wgpu::TextureAspect::All },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes.len() as u32 / height),
            rows_per_image: None,
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

/// Uploads the texels of all images, one image after another, to the layers of a texture array. Each layer is a square
/// of `edge` x `edge` texels.
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

/// Returns the environment image, or one black pixel if there is none.
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
    let is_storage = format == TABLE_FORMAT;
    let read = if is_storage { wgpu::TextureUsages::STORAGE_BINDING } else { wgpu::TextureUsages::TEXTURE_BINDING };
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: read | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Maximum number of bytes staged in memory for one submission; a multiple of table rows.
const UPLOAD_BYTES: usize = 16 << 20;

/// Uploads a layer in batches of rows.
fn write_layer(gpu: &GpuDevice, texture: &wgpu::Texture, z: u32, width: u32, texel_bytes: u32, bytes: &[u8]) {
    let row_bytes = (width * texel_bytes) as usize;
    let rows = (UPLOAD_BYTES / row_bytes).max(1);
    for (i, part) in bytes.chunks(rows * row_bytes).enumerate() {
        let height = (part.len() / row_bytes) as u32;
        write_texture(gpu, texture, wgpu::Origin3d { x: 0, y: (i * rows) as u32, z }, [width, height], part);
        finish_batch(gpu);
    }
}
