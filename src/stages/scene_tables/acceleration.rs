//! The driver's acceleration structures over the scene's triangles, for hardware traversal: one at the bottom for each tree
//! of [`Accel`], and one at the top over its instances.
//!
//! Primitives of a bottom-level structure are numbered as the triangles of its tree. Where some of these are opaque and
//! others ask for their alpha, there is a geometry for either, with all triangles; those of the other kind are points
//! there, which no ray can meet, and so are copies of triangles. So no table is needed that leads from primitives to
//! triangles.

use std::ops::Range;

use wgpu::util::DeviceExt;

use crate::accel::{Accel, Instance, Triangle};
use crate::device::GpuDevice;
use crate::stages::limits::{self, LimitExceeded};

/// Corners lie in triangles, one every so many bytes.
const CORNER_BYTES: u64 = size_of::<Triangle>() as u64 / 3;

const FLAGS: wgpu::AccelerationStructureFlags = wgpu::AccelerationStructureFlags::PREFER_FAST_TRACE;
const UPDATE: wgpu::AccelerationStructureUpdateMode = wgpu::AccelerationStructureUpdateMode::Build;

/// One geometry of a bottom-level structure.
struct Geometry {
    size: wgpu::BlasTriangleGeometrySizeDescriptor,
    /// None: all corners in order.
    indices: Option<wgpu::Buffer>,
}

/// A bottom-level structure and what it is built from.
struct Bottom {
    rows: Range<u32>,
    blas: wgpu::Blas,
    geometries: Vec<Geometry>,
}

/// Builds the structures.
///
/// # Errors
/// If the scene has more triangles or instances than the device takes.
pub fn build(gpu: &GpuDevice, accel: &Accel) -> Result<wgpu::Tlas, LimitExceeded> {
    let largest = accel.trees.iter().map(Range::len).max().unwrap_or(0);
    limits::check(&gpu.device.limits(), gpu.info.index, limits::of_structures(largest, accel.instances.len()))?;
    let is_bare = accel.trees.iter().all(Range::is_empty);
    // The one triangle that is stored where there is none; no ray meets it.
    let stored = is_bare.then_some(0..accel.triangles.len() as u32);
    let rows = accel.trees.iter().cloned().chain(stored).filter(|rows| !rows.is_empty());
    let bottoms: Vec<Bottom> = rows.map(|rows| bottom(gpu, accel, rows)).collect();
    let corners = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("triangles' corners"),
        contents: bytemuck::cast_slice(&accel.triangles),
        usage: wgpu::BufferUsages::BLAS_INPUT,
    });
    let entries: Vec<_> = bottoms.iter().map(|bottom| bottom.entry(&corners)).collect();
    let mut tlas = gpu.device.create_tlas(&wgpu::CreateTlasDescriptor {
        label: Some("instances"),
        max_instances: accel.instances.len() as u32,
        flags: FLAGS,
        update_mode: UPDATE,
    });
    for (i, instance) in accel.instances.iter().enumerate() {
        // The flattened triangles may be none, and then the first mesh begins where they do.
        let is_there = i > 0 || is_bare || !accel.trees[0].is_empty();
        let first_row = instance.first_prim.wrapping_add(instance.row_offset);
        let found = bottoms.binary_search_by_key(&first_row, |bottom| bottom.rows.start);
        let blas = found.ok().filter(|_| is_there).map(|at| &bottoms[at].blas);
        tlas[i] = blas.map(|blas| wgpu::TlasInstance::new(blas, place(instance), i as u32, u8::MAX));
    }
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.build_acceleration_structures(&entries, [&tlas]);
    gpu.queue.submit([encoder.finish()]);
    Ok(tlas)
}

/// Rows of the matrix, one after another.
fn place(instance: &Instance) -> [f32; 12] {
    bytemuck::cast(instance.world_from_local)
}

fn bottom(gpu: &GpuDevice, accel: &Accel, rows: Range<u32>) -> Bottom {
    let triangles = &accel.triangles[rows.start as usize..rows.end as usize];
    let asks_alpha = Triangle::asks_alpha;
    let kinds: Vec<bool> =
        [false, true].into_iter().filter(|&k| triangles.iter().any(|t| asks_alpha(t) == k)).collect();
    let is_first = |i: usize| triangles[i].is_first(rows.start as usize + i);
    let has_points = kinds.len() > 1 || !(0..triangles.len()).all(is_first);
    let corners = 3 * triangles.len() as u32;
    let geometry = |alpha: bool| {
        let opaque = wgpu::AccelerationStructureGeometryFlags::OPAQUE;
        let size = wgpu::BlasTriangleGeometrySizeDescriptor {
            vertex_format: wgpu::VertexFormat::Float32x3,
            vertex_count: corners,
            index_format: has_points.then_some(wgpu::IndexFormat::Uint32),
            index_count: has_points.then_some(corners),
            flags: if alpha { wgpu::AccelerationStructureGeometryFlags::empty() } else { opaque },
        };
        let indices = has_points.then(|| {
            let kinds = (0..).zip(triangles).map(|(i, t)| asks_alpha(t) == alpha && is_first(i));
            gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("corners of opaque triangles, or of others"),
                contents: bytemuck::cast_slice(&indices(kinds)),
                usage: wgpu::BufferUsages::BLAS_INPUT,
            })
        });
        Geometry { size, indices }
    };
    let geometries: Vec<Geometry> = kinds.into_iter().map(geometry).collect();
    let blas = gpu.device.create_blas(
        &wgpu::CreateBlasDescriptor { label: Some("triangles"), flags: FLAGS, update_mode: UPDATE },
        wgpu::BlasGeometrySizeDescriptors::Triangles {
            descriptors: geometries.iter().map(|g| g.size.clone()).collect(),
        },
    );
    Bottom { rows, blas, geometries }
}

/// Corners of all triangles, and one corner three times of those that are left out.
fn indices(is_there: impl Iterator<Item = bool>) -> Vec<u32> {
    let corners = |(i, is_there): (u32, bool)| if is_there { [3 * i, 3 * i + 1, 3 * i + 2] } else { [3 * i; 3] };
    (0..).zip(is_there).flat_map(corners).collect()
}

impl Bottom {
    fn entry<'a>(&'a self, triangles: &'a wgpu::Buffer) -> wgpu::BlasBuildEntry<'a> {
        let geometry = |g: &'a Geometry| wgpu::BlasTriangleGeometry {
            size: &g.size,
            vertex_buffer: triangles,
            first_vertex: 3 * self.rows.start,
            vertex_stride: CORNER_BYTES,
            index_buffer: g.indices.as_ref(),
            first_index: g.indices.as_ref().map(|_| 0),
            transform_buffer: None,
            transform_buffer_offset: None,
        };
        let geometries = self.geometries.iter().map(geometry).collect();
        wgpu::BlasBuildEntry { blas: &self.blas, geometry: wgpu::BlasGeometries::TriangleGeometries(geometries) }
    }
}
