//! The triangles of a scene and the trees over them, as tables.

use std::ops::Range;

use glam::{DVec3, Vec4};

use super::instances::Instance;
use super::moving::{Moved, Placed, Placement, Poses};
use super::skins::Skins;
use super::tree::Node;
use super::triangle::{Shading, Triangle};
use crate::scene::motion::Motion;
use crate::scene::motion::pose::Pose;

/// A scene's triangles and the trees over them.
#[derive(Debug, Default)]
pub struct Accel {
    /// Nodes of all trees. The first is the root over the flattened triangles.
    pub nodes: Vec<Node>,
    /// Triangles in order: flattened ones, those of deforming bodies, and those of shared meshes. Split triangles occur
    /// several times, and degenerate ones, which no ray can hit, are not stored.
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
    /// First triangle number of each instance, and the instance's index, in the first two elements; sorted by number.
    pub numbers: Vec<[u32; 4]>,
    /// Index of the root of the tree over instances, if there are several. Its leaves index [`Self::instances`].
    pub instance_tree: u32,
    pub(super) placements: Vec<Placement>,
    /// Deforming bodies.
    pub skins: Skins,
    /// Rows of each tree's triangles: the flattened ones (may be empty), then bodies and shared meshes.
    pub trees: Vec<Range<u32>>,
    /// World-space origin of all positions on devices. It is (0, 0, 0) unless the scene is so far from there that f32
    /// would round positions coarsely.
    pub origin: DVec3,
}

impl Accel {
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

    /// Returns each body's motion since the previous frame.
    pub fn moved<'a>(&'a self, poses: &'a Poses) -> impl Iterator<Item = Moved> + 'a {
        self.placements.iter().filter_map(|placement| placement.moved(&self.skins, poses, self.origin))
    }
}
