//! Hardware acceleration structures over the scene's triangles: a BLAS for each tree of [`Accel`], and a TLAS over its
//! instances.
//!
//! Primitives of a BLAS are numbered like the triangles of its tree. If a tree mixes opaque and alpha-tested triangles,
//! its BLAS has one geometry for each kind. Both contain all triangles, so that no table is needed to map primitive
//! numbers to triangles. In each geometry, triangles of the other kind are degenerate, so that no ray hits them. If a
//! split triangle is stored several times, all copies but the first are degenerate, too.
//!
//! Dynamic geometry is rebuilt from scratch in each frame: the BLAS of every deforming body, from the vertices that the
//! pass `skin` has written, and the TLAS. Bodies that are left out of a frame are not built in it.

use std::ops::Range;

use super::SceneUpdate;
use crate::accel::{Accel, Instance, SkinTriangle, Skinned, Triangle};
use crate::device::GpuDevice;
use crate::tables::limits::{self, LimitExceeded};

/// Stride of corners, which are stored within triangles, bytes.
const CORNER_BYTES: u64 = size_of::<Triangle>() as u64 / 3;

const FLAGS: wgpu::AccelerationStructureFlags = wgpu::AccelerationStructureFlags::PREFER_FAST_TRACE;
/// Flags of structures that are rebuilt in each frame.
const MOVING_FLAGS: wgpu::AccelerationStructureFlags = wgpu::AccelerationStructureFlags::PREFER_FAST_BUILD;
const UPDATE: wgpu::AccelerationStructureUpdateMode = wgpu::AccelerationStructureUpdateMode::Build;

/// One geometry of a BLAS.
struct Geometry {
    size: wgpu::BlasTriangleGeometrySizeDescriptor,
    /// Index buffer; `None` if all corners are used in order.
    indices: Option<wgpu::Buffer>,
}

/// A BLAS and the inputs of its build.
struct Bottom {
    rows: Range<u32>,
    /// True if the BLAS holds a deforming body, which is built from skinned vertices.
    deforms: bool,
    /// Index of the BLAS's first vertex in its vertex buffer, which holds the skinned vertices for a deforming body and
    /// the corners of all triangles otherwise.
    first_vertex: u32,
    blas: wgpu::Blas,
    geometries: Vec<Geometry>,
}

/// The structures of a scene on one device.
pub struct Structures {
    /// BLASes, sorted by the rows of their triangles in the triangle table.
    bottoms: Vec<Bottom>,
    tlas: wgpu::Tlas,
    /// First row of the instances in the tables.
    instances: u32,
    /// Whether the first instance, which holds the flattened static triangles, contains any triangles.
    has_still: bool,
    /// Deforming bodies of the current frame, as indices into `bottoms`.
    deforming: Vec<usize>,
}

impl Structures {
    /// Builds the BLASes of all geometry that does not deform, and a TLAS over them. [`Self::build`] adds deforming
    /// bodies in each frame. `instances` is the first row of the instances in the tables.
    ///
    /// # Errors
    /// [`LimitExceeded`] if the largest BLAS has more triangles, or the scene more instances, than the device supports.
    pub fn new(gpu: &GpuDevice, accel: &Accel, instances: u32) -> Result<Self, LimitExceeded> {
        let largest = accel.trees.iter().map(Range::len).max().unwrap_or(0);
        let most = accel.instances.len().max(accel.most_instances());
        limits::check(&gpu.device.limits(), gpu.info.index, limits::of_structures(largest, most))?;
        let is_bare = accel.trees.iter().all(Range::is_empty);
        // A scene without triangles stores a single one, which no ray hits.
        let stored = is_bare.then_some(0..accel.triangles.len() as u32);
        let rows = accel.trees.iter().cloned().chain(stored).filter(|rows| !rows.is_empty());
        let bottoms: Vec<Bottom> = rows.map(|rows| bottom(gpu, accel, rows)).collect();
        let corners = bytemuck::cast_slice(&accel.triangles);
        let corners = gpu.filled("triangles' corners", corners, wgpu::BufferUsages::BLAS_INPUT);
        let tlas = gpu.device.create_tlas(&wgpu::CreateTlasDescriptor {
            label: Some("instances"),
            max_instances: most as u32,
            flags: if accel.moves() { MOVING_FLAGS } else { FLAGS },
            update_mode: UPDATE,
        });
        // If there are no flattened triangles, the first mesh begins at the row where they would begin. Then `put` must
        // skip the first instance, since it would find that mesh by the row.
        let has_still = is_bare || !accel.trees[0].is_empty();
        let mut structures = Self { bottoms, tlas, instances, has_still, deforming: Vec::new() };
        structures.put(&accel.instances, false);
        let still = structures.bottoms.iter().filter(|bottom| !bottom.deforms);
        let entries: Vec<_> = still.map(|bottom| bottom.entry(&corners)).collect();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.build_acceleration_structures(&entries, [&structures.tlas]);
        gpu.queue.submit([encoder.finish()]);
        Ok(structures)
    }

    /// Returns the TLAS, which shaders bind.
    pub fn top(&self) -> &wgpu::Tlas {
        &self.tlas
    }

    /// Updates the instances of the TLAS for a frame. The next [`Self::build`] uses them.
    pub fn place(&mut self, update: &SceneUpdate) {
        if let Some((_, bytes)) = update.rows.iter().find(|(first_row, _)| *first_row == self.instances) {
            self.put(&bytemuck::pod_collect_to_vec::<u8, Instance>(bytes), true);
        }
    }

    /// Sets the instances of the TLAS. If `all` is false, it leaves out those of deforming bodies.
    fn put(&mut self, instances: &[Instance], all: bool) {
        self.deforming.clear();
        for i in 0..self.tlas.get().len() {
            let instance = instances.get(i).filter(|_| i > 0 || self.has_still);
            let found = instance.and_then(|instance| {
                let first_row = instance.first_prim.wrapping_add(instance.row_offset);
                let at = self.bottoms.binary_search_by_key(&first_row, |bottom| bottom.rows.start).ok()?;
                (all || !self.bottoms[at].deforms).then_some((instance, at))
            });
            self.deforming.extend(found.map(|(_, at)| at).filter(|&at| self.bottoms[at].deforms));
            let put = |(instance, at): (&Instance, usize)| {
                wgpu::TlasInstance::new(&self.bottoms[at].blas, place(instance), i as u32, u8::MAX)
            };
            self.tlas[i] = found.map(put);
        }
    }

    /// Records the builds of deforming bodies and of the TLAS. `vertices` are the world-space vertices that the pass
    /// `skin` has written.
    pub fn build(&self, encoder: &mut wgpu::CommandEncoder, vertices: &wgpu::Buffer) {
        let entries: Vec<_> = self.deforming.iter().map(|&at| self.bottoms[at].entry(vertices)).collect();
        encoder.build_acceleration_structures(&entries, [&self.tlas]);
    }
}

/// Returns the instance's world-from-local transform: a matrix of 3 rows and 4 columns, row by row.
fn place(instance: &Instance) -> [f32; 12] {
    bytemuck::cast(instance.world_from_local)
}

fn bottom(gpu: &GpuDevice, accel: &Accel, rows: Range<u32>) -> Bottom {
    let triangles = &accel.triangles[rows.start as usize..rows.end as usize];
    let skins = rows.start.checked_sub(accel.skins.first_row).map(|first| first as usize);
    let skins: Option<&[SkinTriangle]> = skins.and_then(|first| accel.skins.triangles.get(first..first + rows.len()));
    let skins = skins.filter(|skins| !skins.is_empty());
    let asks_alpha = Triangle::asks_alpha;
    let kinds: Vec<bool> =
        [false, true].into_iter().filter(|&k| triangles.iter().any(|t| asks_alpha(t) == k)).collect();
    let is_first = |i: usize| triangles[i].is_first(rows.start as usize + i);
    let is_indexed = skins.is_some() || kinds.len() > 1 || !(0..triangles.len()).all(is_first);
    let used = skins.unwrap_or_default().iter().flat_map(|skin| skin.corners.to_array());
    let vertices = used.clone().min().zip(used.max()).map(|(first, last)| first..last + 1);
    let vertices = vertices.unwrap_or(3 * rows.start..3 * rows.end);
    let corners_of = |i: usize| match skins {
        Some(skins) => skins[i].corners.to_array().map(|vertex| vertex - vertices.start),
        None => [0, 1, 2].map(|corner| 3 * i as u32 + corner),
    };
    let geometry = |alpha: bool| {
        let opaque = wgpu::AccelerationStructureGeometryFlags::OPAQUE;
        let size = wgpu::BlasTriangleGeometrySizeDescriptor {
            vertex_format: wgpu::VertexFormat::Float32x3,
            vertex_count: vertices.len() as u32,
            index_format: is_indexed.then_some(wgpu::IndexFormat::Uint32),
            index_count: is_indexed.then_some(3 * triangles.len() as u32),
            flags: if alpha { wgpu::AccelerationStructureGeometryFlags::empty() } else { opaque },
        };
        let indices = is_indexed.then(|| {
            // Make excluded triangles degenerate, with the same corner three times.
            let corners = |(i, t): (usize, &Triangle)| match asks_alpha(t) == alpha && is_first(i) {
                true => corners_of(i),
                false => [corners_of(i)[0]; 3],
            };
            let corners: Vec<u32> = triangles.iter().enumerate().flat_map(corners).collect();
            let label = "corners of opaque triangles, or of others";
            gpu.filled(label, bytemuck::cast_slice(&corners), wgpu::BufferUsages::BLAS_INPUT)
        });
        Geometry { size, indices }
    };
    let geometries: Vec<Geometry> = kinds.into_iter().map(geometry).collect();
    let flags = if skins.is_some() { MOVING_FLAGS } else { FLAGS };
    let blas = gpu.device.create_blas(
        &wgpu::CreateBlasDescriptor { label: Some("triangles"), flags, update_mode: UPDATE },
        wgpu::BlasGeometrySizeDescriptors::Triangles {
            descriptors: geometries.iter().map(|g| g.size.clone()).collect(),
        },
    );
    Bottom { deforms: skins.is_some(), first_vertex: vertices.start, rows, blas, geometries }
}

impl Bottom {
    /// Returns the build's input. `vertices` holds the corners of all triangles, or for a deforming body the skinned
    /// vertices.
    fn entry<'a>(&'a self, vertices: &'a wgpu::Buffer) -> wgpu::BlasBuildEntry<'a> {
        let geometry = |g: &'a Geometry| wgpu::BlasTriangleGeometry {
            size: &g.size,
            vertex_buffer: vertices,
            first_vertex: self.first_vertex,
            vertex_stride: if self.deforms { size_of::<Skinned>() as u64 } else { CORNER_BYTES },
            index_buffer: g.indices.as_ref(),
            first_index: g.indices.as_ref().map(|_| 0),
            transform_buffer: None,
            transform_buffer_offset: None,
        };
        let geometries = self.geometries.iter().map(geometry).collect();
        wgpu::BlasBuildEntry { blas: &self.blas, geometry: wgpu::BlasGeometries::TriangleGeometries(geometries) }
    }
}
