//! Decides which instances keep a shared mesh in local space, which transformed rays traverse, and which are flattened
//! to world space.

use std::collections::{BTreeMap, HashSet};

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DMat3, DVec3, Mat3, Mat4, Vec3, Vec3A, Vec4};
use obvhs::aabb::Aabb;

use super::tree::Tree;
use crate::scene::{AlphaMode, Material, Mesh, Scene};

/// Largest number of triangles that is flattened even if instancing would take less memory. Their widest table then
/// fills 128 MiB, the largest storage buffer binding that every device supports. Rays traverse flattened triangles 1.2
/// to 1.8 times as fast (`benches/rays.rs --two-level` on the forest and the atrium), so instancing is for scenes that
/// would not load otherwise.
const MAX_FLAT: usize = 1 << 21;

/// Factor by which instancing must shrink a scene's tables to be chosen.
const LEAST_SAVING: usize = 2;

/// Bounds on a matrix that rays are transformed by: on its norm and that of its inverse, and on their product, the
/// condition number. Rounding errors grow with them.
const MAX_SCALE: f64 = 1e4;
const MAX_STRETCH: f64 = 1e3;

/// Space in which the triangles of instances are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// Flat, unless the tables would be large and instancing makes them much smaller.
    #[default]
    Auto,
    /// All triangles in world space under one tree.
    Flat,
    /// Shared meshes stored once, in local space.
    TwoLevel,
}

/// A mesh's tree placed in the world, stored as 16-byte rows of the node table.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Instance {
    /// Rows of the matrix, with the translation in w.
    pub world_from_local: [Vec4; 3],
    pub local_from_world: [Vec4; 3],
    /// Number of its first triangle. Triangle numbers continue from instance to instance.
    pub first_prim: u32,
    /// Offset from a triangle's number to its row in the tables, modulo 2^32.
    pub row_offset: u32,
    /// Index of its tree's root node.
    pub root: u32,
    /// 0 if its triangles are stored in world space, else 1.
    pub is_moved: u32,
    /// Rows of `world_from_local` in the previous frame.
    pub last_world_from_local: [Vec4; 3],
}

impl Instance {
    /// Instance of the flattened triangles, with identity transforms.
    pub const STILL: Self = Self {
        world_from_local: [Vec4::X, Vec4::Y, Vec4::Z],
        local_from_world: [Vec4::X, Vec4::Y, Vec4::Z],
        first_prim: 0,
        row_offset: 0,
        root: 0,
        is_moved: 0,
        last_world_from_local: [Vec4::X, Vec4::Y, Vec4::Z],
    };

    pub(super) fn new(place: &Affine3A, last: &Affine3A, first_prim: u32, tree: &Tree) -> Self {
        let linear = Mat3::from(place.matrix3).as_dmat3();
        let inverse = linear.inverse();
        let translation = Vec3::from(place.translation).as_dvec3();
        Self {
            world_from_local: matrix_rows(linear, translation),
            local_from_world: matrix_rows(inverse, -(inverse * translation)),
            first_prim,
            row_offset: tree.first_row.wrapping_sub(first_prim),
            root: tree.root,
            is_moved: 1,
            last_world_from_local: matrix_rows(
                Mat3::from(last.matrix3).as_dmat3(),
                Vec3::from(last.translation).as_dvec3(),
            ),
        }
    }
}

/// Returns the rows of a matrix, with the translation in w.
pub(super) fn matrix_rows(linear: DMat3, translation: DVec3) -> [Vec4; 3] {
    [0, 1, 2].map(|i| linear.row(i).extend(translation[i]).as_vec4())
}

/// A mesh that instances use in local space. Its instances are all mirrored or all not.
#[derive(Debug)]
pub(super) struct Shared {
    pub mesh: usize,
    pub mirrored: bool,
    /// Indices of its instances.
    pub users: Vec<usize>,
}

/// A scene's instances, divided by how their triangles are stored.
#[derive(Debug)]
pub(super) struct Division {
    /// Indices of the flattened instances, in order.
    pub flat: Vec<usize>,
    pub shared: Vec<Shared>,
    /// Indices of the bodies that are transformed to world space in each frame.
    pub deforming: Vec<usize>,
}

impl Division {
    /// Divides the instances by how their triangles are stored. Static instances are flattened if they share no mesh,
    /// emit light (lights are world-space triangles) or have an ill-conditioned transform; with a flat layout, all
    /// static ones are. Emissive and ill-conditioned bodies are stored as deforming bodies, like those that change
    /// their shape.
    pub fn new(scene: &Scene, layout: Layout) -> Self {
        let divided = Self::of_layout(scene, layout == Layout::Flat);
        let stored = divided.stored_triangles(scene);
        let is_small = scene.triangle_count() <= MAX_FLAT || stored * LEAST_SAVING > scene.triangle_count();
        if layout == Layout::Auto && is_small { Self::of_layout(scene, true) } else { divided }
    }

    /// Divides the instances. If `flattens`, all static ones are flattened. Static copies of an opaque instance at the same
    /// place are left out, since they cannot be seen, and rays would test all of them.
    fn of_layout(scene: &Scene, flattens: bool) -> Self {
        let mut moving = vec![None; scene.instances.len()];
        for (number, body) in scene.motion.bodies.iter().enumerate() {
            moving[body.instance] = Some((number, body));
        }
        let mut sharing: BTreeMap<(usize, bool), Vec<usize>> = BTreeMap::new();
        let (mut flat, mut deforming) = (Vec::new(), Vec::new());
        let mut places = HashSet::new();
        for (i, instance) in scene.instances.iter().enumerate() {
            let material = scene.meshes[instance.mesh].material;
            let place = instance.world_from_local.to_cols_array().map(f32::to_bits);
            let is_opaque = scene.materials[material].alpha_mode == AlphaMode::Opaque;
            if moving[i].is_none() && is_opaque && !places.insert((instance.mesh, place)) {
                continue;
            }
            let stays = glows(scene, material) || !is_undone_well(&instance.world_from_local);
            match moving[i] {
                Some((number, body)) if stays || body.deforms() => deforming.push(number),
                None if stays || flattens => flat.push(i),
                _ => {
                    let mirrored = instance.world_from_local.matrix3.determinant() < 0.0;
                    sharing.entry((instance.mesh, mirrored)).or_default().push(i);
                }
            }
        }
        let is_alone = |users: &[usize]| users.len() == 1 && moving[users[0]].is_none();
        flat.extend(sharing.values().filter(|users| is_alone(users)).flatten());
        flat.sort_unstable();
        let shared = sharing.into_iter().filter(|(_, users)| !is_alone(users));
        let shared = shared.map(|((mesh, mirrored), users)| Shared { mesh, mirrored, users });
        Self { flat, shared: shared.collect(), deforming }
    }

    /// Returns the number of triangles that the tables hold.
    pub fn stored_triangles(&self, scene: &Scene) -> usize {
        let bodies = self.deforming.iter().map(|&b| &scene.motion.bodies[b].instance);
        let flat = self.flat.iter().chain(bodies).map(|&i| scene.instances[i].mesh);
        flat.chain(self.shared.iter().map(|s| s.mesh)).map(|m| scene.meshes[m].triangles.len()).sum()
    }
}

/// Returns true if the material emits light at any time or is unlit.
fn glows(scene: &Scene, material: usize) -> bool {
    let Material { unlit, emissive, .. } = scene.materials[material];
    unlit || emissive != Vec3::ZERO || scene.motion.emitters.iter().any(|e| e.index == material)
}

/// Returns true if transforming rays to local space and hits back loses little precision.
pub(super) fn is_undone_well(place: &Affine3A) -> bool {
    let linear = Mat3::from(place.matrix3).as_dmat3();
    let norm = |m: DMat3| m.to_cols_array().map(|x| x * x).iter().sum::<f64>().sqrt();
    let (size, inverse) = (norm(linear), norm(linear.inverse()));
    size <= MAX_SCALE && inverse <= MAX_SCALE && size * inverse <= MAX_STRETCH
}

/// Returns world-space bounds of a mesh, rounded outwards.
pub(super) fn bounds(mesh: &Mesh, place: &Affine3A) -> Aabb {
    let mut out = Aabb::empty();
    let mut farthest = Vec3::ZERO;
    for &p in &mesh.positions {
        out.extend(place.transform_point3(p).into());
        farthest = farthest.max(p.abs());
    }
    grown(out, &Mat4::from(*place), farthest)
}

/// Returns bounds of a transformed box, rounded outwards.
pub(super) fn box_in(place: &Mat4, low: Vec3, high: Vec3) -> Aabb {
    let mut out = Aabb::empty();
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        out.extend(place.transform_point3(Vec3::new(pick(0), pick(1), pick(2))).into());
    }
    grown(out, place, low.abs().max(high.abs()))
}

/// Returns the largest distance of a point in the box from (0, 0, 0).
pub(super) fn farthest(bounds: &Aabb) -> f32 {
    bounds.min.abs().max(bounds.max.abs()).length()
}

/// Grows the bounds by eight times the rounding error of transforming a point with coordinates up to `farthest`.
fn grown(bounds: Aabb, place: &Mat4, farthest: Vec3) -> Aabb {
    let terms = place.x_axis.abs() * farthest.x
        + place.y_axis.abs() * farthest.y
        + place.z_axis.abs() * farthest.z
        + place.w_axis.abs();
    let slack = Vec3A::from(terms.truncate() * 2f32.powi(-19));
    Aabb::new(bounds.min - slack, bounds.max + slack)
}
