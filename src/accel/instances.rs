//! Which instances keep a mesh's triangles in its own space, to be met there by transformed rays, and which are flattened.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DMat3, DVec3, Mat3, Vec3, Vec3A, Vec4};
use obvhs::aabb::Aabb;

use super::Layout;
use super::flatten::near_from_local;
use crate::scene::{self, Mesh, Scene};

/// Most triangles that are flattened even if instances would be smaller: their widest table then fills the 128 MiB that
/// every device lets a shader read at once. Rays find flattened triangles 1.2 to 1.8 times as fast (`benches/rays.rs
/// --two-level` on the forest and the atrium), so that instances are for what would not load otherwise.
const MAX_FLAT: usize = 1 << 21;

/// How many times smaller instances have to make a scene's tables.
const LEAST_SAVING: usize = 2;

/// Largest and least size of transforms that rays follow, and by how much they may stretch one direction over another
/// (as the product of the norms of a matrix and its inverse): the bounds on rounding grow with it.
const MAX_SCALE: f64 = 1e4;
const MAX_STRETCH: f64 = 1e3;

/// A mesh's tree put into the world, as rows of 16 bytes of the table of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Instance {
    /// Rows of the matrix, translations in w.
    pub world_from_local: [Vec4; 3],
    pub local_from_world: [Vec4; 3],
    /// Number of its first triangle. Numbers count on from instance to instance.
    pub first_prim: u32,
    /// What is added to a triangle's number for its place in the tables, modulo 2^32.
    pub row_offset: u32,
    /// Root of its tree.
    pub root: u32,
    /// 0 where its triangles lie as in the tables.
    pub is_moved: u32,
}

impl Instance {
    /// The flattened triangles.
    pub const STILL: Self = Self {
        world_from_local: [Vec4::X, Vec4::Y, Vec4::Z],
        local_from_world: [Vec4::X, Vec4::Y, Vec4::Z],
        first_prim: 0,
        row_offset: 0,
        root: 0,
        is_moved: 0,
    };

    pub(super) fn new(place: &Affine3A, first_prim: u32, first_row: u32, root: u32) -> Self {
        let linear = Mat3::from(place.matrix3).as_dmat3();
        let inverse = linear.inverse();
        let translation = Vec3::from(place.translation).as_dvec3();
        Self {
            world_from_local: rows(linear, translation),
            local_from_world: rows(inverse, -(inverse * translation)),
            first_prim,
            row_offset: first_row.wrapping_sub(first_prim),
            root,
            is_moved: 1,
        }
    }
}

fn rows(linear: DMat3, translation: DVec3) -> [Vec4; 3] {
    [0, 1, 2].map(|i| linear.row(i).extend(translation[i]).as_vec4())
}

/// A mesh that several instances share, all of them mirrored or none.
#[derive(Debug)]
pub(super) struct Shared {
    pub mesh: usize,
    pub mirrored: bool,
    pub places: Vec<Affine3A>,
}

/// A scene's instances.
#[derive(Debug)]
pub(super) struct Division {
    /// Indices of those that are flattened, in order.
    pub flat: Vec<usize>,
    pub shared: Vec<Shared>,
}

impl Division {
    /// Flattened are all that share no mesh, that glow, since lights are triangles of the world, and those whose
    /// transform cannot be undone well.
    pub fn new(scene: &Scene, origin: DVec3, layout: Layout) -> Self {
        let all_flat = || Self { flat: (0..scene.instances.len()).collect(), shared: Vec::new() };
        if layout == Layout::Flat || layout == Layout::Auto && scene.triangle_count() <= MAX_FLAT {
            return all_flat();
        }
        let divided = Self::two_level(scene, origin);
        let stored = divided.stored_triangles(scene);
        if layout == Layout::Auto && stored * LEAST_SAVING > scene.triangle_count() { all_flat() } else { divided }
    }

    fn two_level(scene: &Scene, origin: DVec3) -> Self {
        let mut sharing: BTreeMap<(usize, bool), Vec<usize>> = BTreeMap::new();
        let mut flat = Vec::new();
        for (i, instance) in scene.instances.iter().enumerate() {
            let material = &scene.materials[scene.meshes[instance.mesh].material];
            if material.unlit || material.emissive != Vec3::ZERO || !is_undone_well(&instance.world_from_local) {
                flat.push(i);
            } else {
                let mirrored = instance.world_from_local.matrix3.determinant() < 0.0;
                sharing.entry((instance.mesh, mirrored)).or_default().push(i);
            }
        }
        flat.extend(sharing.values().filter(|users| users.len() == 1).flatten());
        flat.sort_unstable();
        let place = |i: &usize| near_from_local(&scene.instances[*i], origin);
        let shared = sharing.into_iter().filter(|(_, users)| users.len() > 1);
        let shared = shared.map(|((mesh, mirrored), users)| {
            let places = users.iter().map(place).collect();
            Shared { mesh, mirrored, places }
        });
        Self { flat, shared: shared.collect() }
    }

    /// Triangles that the tables hold.
    pub fn stored_triangles(&self, scene: &Scene) -> usize {
        let flat = self.flat.iter().map(|&i| scene.instances[i].mesh);
        flat.chain(self.shared.iter().map(|s| s.mesh)).map(|m| scene.meshes[m].triangles.len()).sum()
    }

    pub fn flat<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = &'a scene::Instance> {
        self.flat.iter().map(|&i| &scene.instances[i])
    }
}

/// Whether rays can be brought into an instance's space and hits back without much loss.
fn is_undone_well(place: &Affine3A) -> bool {
    let linear = Mat3::from(place.matrix3).as_dmat3();
    let norm = |m: DMat3| m.to_cols_array().map(|x| x * x).iter().sum::<f64>().sqrt();
    let (size, inverse) = (norm(linear), norm(linear.inverse()));
    size <= MAX_SCALE && inverse <= MAX_SCALE && size * inverse <= MAX_STRETCH
}

/// World-space bounds of a mesh in its place, rounded up.
pub(super) fn bounds(mesh: &Mesh, place: &Affine3A) -> Aabb {
    let mut out = Aabb::empty();
    let mut farthest = Vec3::ZERO;
    for &p in &mesh.positions {
        out.extend(place.transform_point3(p).into());
        farthest = farthest.max(p.abs());
    }
    let linear = Mat3::from(place.matrix3);
    let terms = linear.x_axis.abs() * farthest.x
        + linear.y_axis.abs() * farthest.y
        + linear.z_axis.abs() * farthest.z
        + Vec3::from(place.translation).abs();
    // Eight times the error of a transformed point.
    let slack = terms * 2f32.powi(-19);
    Aabb::new(out.min - Vec3A::from(slack), out.max + Vec3A::from(slack))
}
