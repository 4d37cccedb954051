//! Placement of instances in the world, in the current frame and in the previous one.

use glam::{Affine3A, DAffine3, DVec3, Mat3, Mat4, Vec3, Vec3A, Vec4};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;

use super::boxes::tree_over_boxes;
use super::built::depth;
use super::instances::{Instance, box_in, farthest, is_undone_well};
use super::limits::{MAX_INSTANCE_DEPTH, MAX_REACH};
use super::skins::Skins;
use super::tree::{Node, Tree, nodes_from};
use crate::scene::motion::Motion;
use crate::scene::motion::pose::{Pose, narrow};

/// A tree with its placement in the world.
#[derive(Debug)]
pub(super) struct Placement {
    pub tree: Tree,
    /// Number of its first triangle.
    pub first_prim: u32,
    /// True if it is a perfect mirror or clear glass.
    pub is_mirror: bool,
    pub by: By,
}

/// A body's motion since the previous frame.
#[derive(Clone, Copy, Debug)]
pub struct Moved {
    /// Current bounds.
    pub bounds: Aabb,
    /// Upper bound on the motion of its points, in scene units.
    pub by: f32,
    /// Upper bound on the rotation of its surfaces, in radians, if they are mirrors or glass.
    pub mirrors_turned: Option<f32>,
}

#[derive(Debug)]
pub(super) enum By {
    /// A static instance, with world-space bounds of its triangles.
    Place(Affine3A, Aabb),
    /// A rigid body, with the minimum and maximum coordinates of its mesh.
    Body { number: usize, low: Vec3, high: Vec3 },
    /// Index of a body in [`Skins`].
    Skin(usize),
}

/// Poses of a dynamic scene in the current frame and in the previous one.
pub struct Poses<'a> {
    pub motion: &'a Motion,
    pub now: &'a Pose,
    pub last: &'a Pose,
    /// Rows of the poses, from [`Skins::pose_rows`].
    pub rows: &'a [Vec4],
}

/// Instances with the tree over them.
#[derive(Debug, Default)]
pub struct Placed {
    /// [`Instance::STILL`], then the other instances in tree order.
    pub instances: Vec<Instance>,
    /// First triangle number of each instance, and the instance's index, in the first two elements; sorted by number.
    pub numbers: Vec<[u32; 4]>,
    /// Nodes of the tree, at most one per instance.
    pub nodes: Vec<Node>,
    pub levels: usize,
    /// Number of bodies left out because their scale, stretch or distance is too extreme for accurate ray
    /// intersections.
    pub left_out: u32,
}

impl Placed {
    /// Places the instances, and builds the tree over them, whose root has index `root` in the node table. Without
    /// `poses`, only static instances are placed.
    pub(super) fn new(
        placements: &[Placement],
        skins: &Skins,
        poses: Option<&Poses>,
        origin: DVec3,
        root: u32,
    ) -> Self {
        let mut boxes = Vec::with_capacity(placements.len());
        let mut there = Vec::with_capacity(placements.len());
        for (number, placement) in placements.iter().enumerate() {
            if let Some((bounds, instance)) = placement.put(skins, poses, origin) {
                boxes.push(bounds);
                there.push((number, instance));
            }
        }
        let left_out = (placements.len() - there.len()) as u32;
        let mut out = Self { instances: vec![Instance::STILL], numbers: vec![[0; 4]], left_out, ..Self::default() };
        if boxes.is_empty() {
            out.nodes.push(Node::default());
            return out;
        }
        let params = if poses.is_some() { BvhBuildParams::fast_build() } else { BvhBuildParams::slow_build() };
        let params = BvhBuildParams { max_prims_per_leaf: 1, ..params };
        let order = (0..boxes.len() as u32).collect();
        let built = tree_over_boxes(boxes, order, &params, MAX_INSTANCE_DEPTH);
        out.levels = depth(&built.nodes);
        out.nodes.extend(nodes_from(&built.nodes, root, 1));
        for (place, &i) in (1..).zip(&built.order) {
            let (number, instance) = &there[i as usize];
            out.instances.push(*instance);
            out.numbers.push([placements[*number].first_prim, place, 0, 0]);
        }
        out.numbers.sort_unstable();
        out
    }
}

impl Placement {
    pub fn moves(&self) -> bool {
        !matches!(self.by, By::Place(..))
    }

    fn put(&self, skins: &Skins, poses: Option<&Poses>, origin: DVec3) -> Option<(Aabb, Instance)> {
        match (&self.by, poses) {
            (By::Place(place, bounds), _) => Some((*bounds, Instance::new(place, place, self.first_prim, &self.tree))),
            (By::Body { number, low, high }, Some(poses)) => {
                let place = |pose| near(&poses.motion.world_from_body(pose, *number), origin);
                let (now, last) = (place(poses.now), place(poses.last));
                let bounds = box_in(&Mat4::from(now), *low, *high);
                let is_there = is_undone_well(&now) && is_within_reach(&bounds);
                is_there.then(|| (bounds, Instance::new(&now, &last, self.first_prim, &self.tree)))
            }
            (By::Skin(index), Some(poses)) => {
                let bounds = skins.bounds(*index, poses.rows);
                // Its triangles are stored in world space.
                let Tree { first_row: first_prim, root, .. } = self.tree;
                is_within_reach(&bounds).then_some((bounds, Instance { first_prim, root, ..Instance::STILL }))
            }
            (By::Body { .. } | By::Skin(_), None) => None,
        }
    }

    /// Returns `None` for a static instance.
    pub fn moved(&self, skins: &Skins, poses: &Poses, origin: DVec3) -> Option<Moved> {
        let (bounds, by, turned) = match self.by {
            By::Place(..) => return None,
            By::Body { number, low, high } => {
                let place = |pose| Mat4::from(near(&poses.motion.world_from_body(pose, number), origin));
                let (now, last) = (place(poses.now), place(poses.last));
                // The difference of two affine maps is affine, so it is largest at a corner of the box.
                (box_in(&now, low, high), farthest(&box_in(&(now - last), low, high)), turned(&now, &last))
            }
            By::Skin(index) => (skins.bounds(index, poses.rows), skins.moved(index, poses.rows), f32::INFINITY),
        };
        Some(Moved { bounds, by, mirrors_turned: self.is_mirror.then_some(turned) })
    }
}

/// Returns the angle, in radians, of the rotation between two transforms. Changes of scale and shear add to it.
fn turned(now: &Mat4, last: &Mat4) -> f32 {
    let change = Mat3::from_mat4(*last) * Mat3::from_mat4(*now).inverse() - Mat3::IDENTITY;
    // The Frobenius norm of a rotation by an angle `a`, minus the identity, is sqrt(8) sin(a / 2).
    let norm = change.to_cols_array().iter().map(|v| v * v).sum::<f32>().sqrt();
    let sine = norm / 8f32.sqrt();
    match sine < 1.0 {
        _ if now == last => 0.0,
        true => 2.0 * sine.asin(),
        false => f32::INFINITY,
    }
}

/// Returns true if the bounds are small enough to compute areas without overflow.
fn is_within_reach(bounds: &Aabb) -> bool {
    let reach = Vec3A::splat(MAX_REACH as f32);
    (bounds.min.cmpge(-reach) & bounds.max.cmple(reach)).all()
}

fn near(place: &DAffine3, origin: DVec3) -> Affine3A {
    narrow(&DAffine3 { translation: place.translation - origin, ..*place })
}
