//! Acceleration structures: instanced meshes flattened to world space under one compressed wide BVH, in the layout that
//! `shaders/shared/traverse_compute.inc.wgsl` traverses. If that takes too much memory, meshes that several instances
//! share stay in local space with a tree each, under a top-level tree over the instances.
//!
//! Triangles are stored in tree order, so a leaf's triangle index is the triangle's row in every table.

mod build;
mod clearance;
mod flatten;
mod instances;
mod moving;
mod skins;
mod tree;

use std::ops::Range;

use glam::{DVec3, Vec3, Vec4};
use obvhs::aabb::Aabb;

use self::build::checked_origin;
use self::flatten::Present;
use self::instances::Division;
pub use self::instances::Instance;
use self::moving::Placement;
pub use self::moving::{Placed, Poses};
pub use self::skins::{COLUMNS, SKINNED_BYTES, SkinMorph, SkinTriangle, SkinVertex, Skins};
pub(crate) use self::skins::{CONSTANTS as SKIN_CONSTANTS, structs as skin_structs};
use self::tree::{BUILD_BYTES, Room};
use crate::scene::Scene;
use crate::scene::budget::{Budget, Exceeded};
use crate::scene::motion::Motion;
use crate::scene::motion::pose::Pose;
use crate::wgsl::shared_structs;

/// Deepest tree that the shaders' traversal stack holds.
pub const MAX_DEPTH: usize = 32;

/// Largest number of stored triangles. Their tables take 112 bytes each on the host and on every device, 7 GiB in
/// total.
const MAX_TRIANGLES: usize = 1 << 26;

/// Flag in a hit's primitive number: the rest is the number of a sphere light, not of a triangle.
pub const SPHERE: u32 = 1 << 31;

/// Limit on triangles after instancing: larger numbers name spheres.
const MAX_PRIMS: usize = SPHERE as usize;

/// Largest coordinate. Larger ones would overflow sums of areas in the tree's cost.
const MAX_REACH: f64 = 1e14;

/// Upper bound on the bytes per instance while the tree over instances is built, including that tree.
const INSTANCE_BYTES: usize = 1000;

/// Flag in [`Triangle::first_copy`]: the material's alpha decides whether the triangle stops a ray.
pub const TRIANGLE_ALPHA: u32 = 1 << 31;

shared_structs! {
    /// A triangle as rays intersect it: exact vertices, counter-clockwise from the front. Both triangles at an edge
    /// store the same bits for its vertices.
    pub struct Triangle {
        pub v0: Vec3,
        pub material: u32,
        pub v1: Vec3,
        /// Row of its first copy, which identifies it in hits, and [`TRIANGLE_ALPHA`]. A large triangle that was split
        /// among several leaves has a copy in each.
        pub first_copy: u32,
        pub v2: Vec3,
        /// Number of its light, if any; set once lights are known.
        pub light: u32,
    }

    /// Attributes interpolated over a triangle: normals and texture coordinates, with u and v packed between the
    /// normals.
    pub struct Shading {
        pub n0: Vec3,
        pub u0: f32,
        pub n1: Vec3,
        pub v0: f32,
        pub n2: Vec3,
        pub u1: f32,
        pub v1: f32,
        pub u2: f32,
        pub v2: f32,
        pub pad: f32,
    }
}

impl Triangle {
    pub fn area(&self) -> f32 {
        0.5 * (self.v1 - self.v0).cross(self.v2 - self.v0).length()
    }

    pub fn asks_alpha(&self) -> bool {
        self.first_copy & TRIANGLE_ALPHA != 0
    }

    /// Returns true if `row` is its first copy.
    pub fn is_first(&self, row: usize) -> bool {
        (self.first_copy & !TRIANGLE_ALPHA) as usize == row
    }
}

/// A node of 80 bytes in obvhs's layout.
pub type Node = [u32; 20];

/// Storage of instances.
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

/// A scene's triangles and the trees over them.
#[derive(Debug)]
pub struct Accel {
    /// Nodes of all trees. The first is the root over the flattened triangles.
    pub nodes: Vec<Node>,
    /// Triangles in order: flattened ones, those of deforming bodies, and those of shared meshes. Split triangles occur
    /// several times.
    pub triangles: Vec<Triangle>,
    pub shadings: Vec<Shading>,
    /// Linear RGBA colours, three per triangle; empty if no mesh has colours.
    pub colors: Vec<[f32; 4]>,
    /// Texture coordinate set 1, three per triangle; empty if unused.
    pub second_uvs: Vec<[f32; 2]>,
    /// Tangents, three per triangle with the bitangent's sign in w; empty if no mesh has tangents.
    pub tangents: Vec<[f32; 4]>,
    /// [`Instance::STILL`], then the other instances in tree order, in their pose at time 0.
    pub instances: Vec<Instance>,
    /// Pairs of an instance's first triangle number and its index, sorted by number.
    pub numbers: Vec<[u32; 4]>,
    /// Index of the root of the tree over instances, if there are several. Its leaves index [`Self::instances`].
    pub instance_tree: u32,
    placements: Vec<Placement>,
    /// Deforming bodies.
    pub skins: Skins,
    /// Rows of each tree's triangles: the flattened ones (may be empty), then bodies and shared meshes.
    pub trees: Vec<Range<u32>>,
    /// Number of degenerate triangles, which no ray can hit and which are not stored.
    pub dropped: usize,
    /// World-space origin of all positions on devices. It is (0, 0, 0) unless the scene is so far from there that f32
    /// would round positions coarsely.
    pub origin: DVec3,
}

#[derive(Debug, thiserror::Error)]
pub enum AccelError {
    #[error(
        "the scene's tree is {depth} levels deep, more than the {MAX_DEPTH} a ray's stack holds: its triangles are stacked on one another, simplify the scene"
    )]
    TooDeep { depth: usize },
    #[error(
        "the scene has {0} triangles, those that instances share counted once, more than the {MAX_TRIANGLES} that fit into memory: simplify it"
    )]
    TooMany(usize),
    #[error(
        "the scene has {0} triangles after instancing, more than the {MAX_PRIMS} that can be told apart: simplify it"
    )]
    TooManyInstances(usize),
    #[error(
        "the scene reaches to {0:e} units, more than the {MAX_REACH:e} that areas can be reckoned with: scale it down"
    )]
    TooLarge(f64),
    #[error("the scene's {triangles} triangles after instancing are refused: {exceeded}")]
    Memory { triangles: usize, exceeded: Exceeded },
}

impl Accel {
    /// Builds with [`Layout::Auto`].
    ///
    /// # Errors
    /// If the scene is too large for the tables or the tree too deep for rays.
    pub fn build(scene: &Scene) -> Result<Self, AccelError> {
        Self::build_with(scene, Layout::Auto)
    }

    /// Builds the trees deterministically: the same scene gives the same trees.
    ///
    /// # Errors
    /// If the scene is too large for the tables or the trees too deep for rays.
    pub fn build_with(scene: &Scene, layout: Layout) -> Result<Self, AccelError> {
        Self::build_within(scene, layout, &Budget::unlimited())
    }

    /// Builds like [`Self::build_with`]. The budget keeps the bytes of the finished tables reserved.
    ///
    /// # Errors
    /// Errors of [`Self::build_with`], and if the budget is too small.
    pub fn build_within(scene: &Scene, layout: Layout, budget: &Budget) -> Result<Self, AccelError> {
        let count = scene.triangle_count();
        if count >= MAX_PRIMS {
            return Err(AccelError::TooManyInstances(count));
        }
        let origin = checked_origin(scene)?;
        let refused = |exceeded| AccelError::Memory { triangles: count, exceeded };
        let instances = scene.instances.len() * INSTANCE_BYTES;
        let _instances = budget.reserve(instances as u64).map_err(refused)?;
        let division = Division::new(scene, layout);
        let stored = division.stored_triangles(scene);
        if stored > MAX_TRIANGLES {
            return Err(AccelError::TooMany(stored));
        }
        let present = Present::of(scene);
        // Lists grow to at most twice their length, and are copied into tree order.
        let making = stored as u64 * (4 * present.row_bytes() + BUILD_BYTES) as u64;
        let mut reserved = budget.reserve(making).map_err(refused)?;
        let bodies =
            division.deforming.iter().map(|&b| &scene.meshes[scene.instances[scene.motion.bodies[b].instance].mesh]);
        budget.reserve(bodies.map(Skins::bytes).sum()).map_err(refused)?.keep();
        let mut accel = Self { origin, ..Self::empty() };
        let room = Room { budget, row_bytes: present.row_bytes(), triangles: count };
        let (flat, _) =
            accel.push_tree(&flatten::flatten(scene, division.flat(scene), origin, &present), true, &room)?;
        let deepest = accel.push_bodies(scene, &division.deforming, &present, &room)?;
        let deepest = deepest.max(accel.push_shared(scene, &division.shared, &present, &room)?);
        let pose = scene.motion.pose(0.0);
        let rows = accel.pose_rows(&scene.motion, [&pose, &pose]);
        let poses = Poses { motion: &scene.motion, now: &pose, last: &pose, rows: &rows };
        accel.instance_tree = accel.nodes.len() as u32;
        let placed = accel.placed_at((!scene.motion.bodies.is_empty()).then_some(&poses));
        (accel.instances, accel.numbers) = (placed.instances, placed.numbers);
        if !accel.placements.is_empty() {
            accel.nodes.extend(placed.nodes);
            // Reserves nodes for the largest number of instances in any frame.
            let last = accel.instance_tree as usize + accel.placements.len();
            accel.nodes.resize(accel.nodes.len().max(if accel.moves() { last } else { 0 }), Node::default());
        }
        // The root over instances stays on the stack while rays traverse the flattened triangles.
        let waiting = usize::from(!accel.placements.is_empty());
        let levels = (flat.levels + waiting).max(deepest + placed.levels);
        if levels > MAX_DEPTH {
            return Err(AccelError::TooDeep { depth: levels });
        }
        if accel.triangles.is_empty() {
            // Buffers must not be empty.
            accel.triangles.push(Triangle::default());
            accel.shadings.push(Shading::default());
        }
        reserved.shrink_to((stored * room.stored_bytes()) as u64);
        reserved.keep();
        Ok(accel)
    }

    fn empty() -> Self {
        Self {
            nodes: Vec::new(),
            triangles: Vec::new(),
            shadings: Vec::new(),
            colors: Vec::new(),
            second_uvs: Vec::new(),
            tangents: Vec::new(),
            instances: vec![Instance::STILL],
            numbers: vec![[0; 4]],
            instance_tree: 0,
            placements: Vec::new(),
            skins: Skins::default(),
            trees: Vec::new(),
            dropped: 0,
            origin: DVec3::ZERO,
        }
    }

    /// Returns the placed instances and the tree over them. Without `poses`, only static instances are placed.
    pub fn placed_at(&self, poses: Option<&Poses>) -> Placed {
        Placed::new(&self.placements, &self.skins, poses, self.origin, self.instance_tree)
    }

    /// Copies the light numbers of triangles to the deforming bodies.
    pub fn know_lights(&mut self) {
        let rows = &self.triangles[self.skins.first_row as usize..];
        self.skins.triangles.iter_mut().zip(rows).for_each(|(skin, row)| skin.light = row.light);
    }

    /// Returns true if any triangles move.
    pub fn moves(&self) -> bool {
        self.placements.iter().any(Placement::moves)
    }

    /// Returns the largest number of instances in any frame, including [`Instance::STILL`].
    pub fn most_instances(&self) -> usize {
        1 + self.placements.len()
    }

    /// Returns the pose as rows for shaders, for the current and the previous frame.
    pub fn pose_rows(&self, motion: &Motion, poses: [&Pose; 2]) -> Vec<Vec4> {
        let of = |number: usize| poses.map(|pose| (motion.joints(pose, number), pose.weights[number].clone()));
        self.skins.pose_rows(of, self.origin)
    }

    /// Returns each moving body's bounds and an upper bound on its motion since the previous frame, in scene units.
    pub fn moved<'a>(&'a self, poses: &'a Poses) -> impl Iterator<Item = (Aabb, f32)> + 'a {
        self.placements.iter().filter_map(|placement| placement.moved(&self.skins, poses, self.origin))
    }
}

#[cfg(test)]
mod tests {
    use super::build::origin_for;
    use super::*;
    use crate::scene::{Bounds, builtin};

    #[test]
    fn building_keeps_every_triangle_with_area() {
        let scene = (builtin::find("cornell").unwrap().build)();
        let accel = Accel::build(&scene).unwrap();
        let is_first = |&(row, t): &(usize, &Triangle)| t.is_first(row);
        let firsts = accel.triangles.iter().enumerate().filter(is_first).count();
        assert_eq!(firsts + accel.dropped, scene.triangle_count());
        assert!(accel.triangles.iter().all(|t| t.area() > 0.0));
    }

    #[test]
    fn more_triangles_than_numbers_are_refused() {
        let mut scene = (builtin::find("cornell").unwrap().build)();
        let mesh = scene.instances[0].mesh;
        scene.meshes[mesh].triangles = vec![[0, 1, 2]; 1 << 20];
        scene.instances = vec![scene.instances[0]; 1 << 11];
        assert!(matches!(Accel::build(&scene), Err(AccelError::TooManyInstances(count)) if count == MAX_PRIMS));
    }

    #[test]
    fn bodies_out_of_reach_are_refused_or_left_out() {
        let studio = (builtin::find("studio").unwrap().build)();
        let accel = Accel::build(&studio).unwrap();
        let with_joints = |scale: f32| {
            let mut scene = studio.clone();
            let binds = scene.motion.skins.iter_mut().flat_map(|skin| &mut skin.inverse_bind);
            binds.for_each(|bind| bind.matrix3 *= scale);
            scene
        };
        for far in [1e20, 1e38] {
            let scene = with_joints(far);
            assert!(matches!(Accel::build(&scene), Err(AccelError::TooLarge(_))));
            let pose = scene.motion.pose(0.0);
            let rows = accel.pose_rows(&scene.motion, [&pose, &pose]);
            let poses = Poses { motion: &scene.motion, now: &pose, last: &pose, rows: &rows };
            let placed = accel.placed_at(Some(&poses));
            assert_eq!(placed.left_out as usize, studio.motion.skins.len());
            assert_eq!(placed.instances.len() + studio.motion.skins.len(), accel.instances.len());
        }
    }

    #[test]
    fn scenes_far_off_are_brought_near() {
        let bounds = |at: f32| Bounds { min: Vec3::splat(at - 1.0), max: Vec3::splat(at + 2.0) };
        assert_eq!(origin_for(bounds(0.0)), DVec3::ZERO);
        assert_eq!(origin_for(bounds(-5.0)), DVec3::ZERO);
        assert_eq!(origin_for(bounds(1e5)), DVec3::splat(1e5));
        assert_eq!(origin_for(Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY }), DVec3::ZERO);
    }

    #[test]
    fn building_twice_gives_the_same_tree() {
        let scene = (builtin::find("checker").unwrap().build)();
        let (a, b) = (Accel::build(&scene).unwrap(), Accel::build(&scene).unwrap());
        assert_eq!(a.nodes, b.nodes);
        assert_eq!(bytemuck::cast_slice::<_, u32>(&a.triangles), bytemuck::cast_slice::<_, u32>(&b.triangles));
    }
}
