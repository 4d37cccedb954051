//! Dynamic part of a scene: a hierarchy of nodes, its animations, and the meshes, lights and cameras attached to it.
//!
//! [`Motion::pose`] evaluates everything at one time in f64; [`Scene::at`](super::Scene::at) returns the static scene
//! of that time. The methods are those of glTF 2.0: sections 3.7.2.2 (morph targets), 3.7.3 (skins), 3.11 (animations)
//! and appendix C (interpolation).

pub mod keys;
pub mod play;
pub mod pose;
pub mod bake;

use std::collections::BTreeSet;

use glam::{Affine3A, DAffine3, DQuat, DVec3, Vec3};
use serde::Serialize;

use self::keys::Keys;

/// Motion of a scene; empty if the scene is static.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// Nodes that a body, a light or a camera depends on. Parents precede their children.
    pub nodes: Vec<Node>,
    /// Animations, all played at once. No two channels share a target.
    pub animations: Vec<Animation>,
    pub skins: Vec<Skin>,
    /// Instances that may move. Each occurs once.
    pub bodies: Vec<Body>,
    /// Lights on nodes, at the node's origin and shining along its −z.
    pub lights: Vec<Attached>,
    /// Cameras on nodes, at the node's origin and looking along its −z.
    pub cameras: Vec<Attached>,
    /// Emission of animated materials at rest; `index` points into [`Scene::materials`](super::Scene::materials).
    pub emitters: Vec<Emitter>,
    /// Emission of animated lights at rest; `index` points into [`Scene::lights`](super::Scene::lights).
    pub lamps: Vec<Emitter>,
    /// True if animations loop; otherwise each one stays at its end.
    pub loops: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Name in the file; may be empty.
    pub name: String,
    /// Index of the parent in [`Motion::nodes`], smaller than the node's own; `None` for a root.
    pub parent: Option<usize>,
    /// Transform from the node to its parent, unless animated.
    pub rest: Placement,
}

/// A transform from a node to its parent, scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// Scale, then rotation (a unit quaternion), then translation.
    Parts { translation: DVec3, rotation: DQuat, scale: DVec3 },
    /// Matrix of a node without animation.
    Matrix(DAffine3),
}

impl Placement {
    pub fn affine(&self) -> DAffine3 {
        match *self {
            Self::Parts { translation, rotation, scale } => {
                DAffine3::from_scale_rotation_translation(scale, rotation, translation)
            }
            Self::Matrix(matrix) => matrix,
        }
    }
}

/// An instance that may move.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Index into [`Scene::instances`](super::Scene::instances).
    pub instance: usize,
    /// Index into [`Motion::nodes`]. With a skin, the node's transform is ignored.
    pub node: usize,
    /// Index into [`Motion::skins`]. With a skin, the mesh has influences on the skin's joints, and its instance's
    /// transform is the identity.
    pub skin: Option<usize>,
    /// Weight of each morph target of the mesh, unless animated; empty to ignore all morph targets.
    pub weights: Vec<f32>,
}

impl Body {
    /// Returns true if the instance is skinned or morphed; otherwise it is a rigid body.
    pub fn deforms(&self) -> bool {
        self.skin.is_some() || !self.weights.is_empty()
    }
}

/// A skeleton for a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// Indices into [`Motion::nodes`]; at least one.
    pub joints: Vec<usize>,
    /// Inverse bind matrices: transforms from the mesh to each joint, one per joint.
    pub inverse_bind: Vec<Affine3A>,
}

/// A light or camera on a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attached {
    /// Index into [`Scene::lights`](super::Scene::lights) or [`Scene::cameras`](super::Scene::cameras).
    pub index: usize,
    /// Index into [`Motion::nodes`].
    pub node: usize,
}

/// Emission as the product of two separately animated factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    pub index: usize,
    pub color: Vec3,
    pub strength: f32,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// Name in the file; may be empty.
    pub name: String,
    pub channels: Vec<Channel>,
    /// Duration in seconds, at least the time of the last key. An animation of 0 s is static.
    pub duration_s: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    pub target: Target,
    /// Keys with as many components as the target: 1 for strengths, 4 for rotations (x, y, z, w) and base colours, the
    /// number of morphs for weights, else 3.
    pub keys: Keys,
}

/// Property that a channel animates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Target {
    /// Translation of the node with that index in [`Motion::nodes`], which must have [`Placement::Parts`]. The next two
    /// variants refer to a node in the same way.
    Translation(usize),
    Rotation(usize),
    Scale(usize),
    /// Morph weights of all bodies on that node.
    Weights(usize),
    /// Base colour of the material with that index into [`Scene::materials`](super::Scene::materials).
    BaseColor(usize),
    /// Emissive colour of the emitter with that index in [`Motion::emitters`]. The next variant uses the same index.
    EmissiveColor(usize),
    EmissiveStrength(usize),
    /// Colour of the light with that index in [`Motion::lamps`]. The next variant uses the same index.
    LightColor(usize),
    LightIntensity(usize),
}

/// Summary of a scene's motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Moves {
    /// Animations in play.
    pub animations: Vec<PlayedAnimation>,
    /// Number of nodes that moving instances, lights and cameras depend on.
    pub nodes: usize,
    /// Skeletons in use.
    pub skins: usize,
    /// Instances that follow a node as rigid bodies.
    pub rigid_instances: usize,
    /// Instances with a skin.
    pub skinned_instances: usize,
    /// Instances with morph targets that are animated or have weights.
    pub morphing_instances: usize,
    /// Lights with animated position or strength.
    pub lights: usize,
    pub cameras: usize,
    /// Materials with animated values.
    pub materials: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PlayedAnimation {
    pub name: String,
    pub duration_s: f64,
}

impl Motion {
    /// Returns true if the scene is static.
    pub fn is_empty(&self) -> bool {
        let Self { bodies, lights, cameras, animations, .. } = self;
        bodies.is_empty() && lights.is_empty() && cameras.is_empty() && animations.is_empty()
    }

    /// Returns the end of the longest animation in seconds.
    pub fn duration_s(&self) -> f64 {
        self.animations.iter().map(|a| a.duration_s).fold(0.0, f64::max)
    }

    /// Returns the indices of the materials with animated values.
    pub fn changing_materials(&self) -> BTreeSet<usize> {
        let colored = self.animations.iter().flat_map(|a| &a.channels).filter_map(|channel| match channel.target {
            Target::BaseColor(material) => Some(material),
            _ => None,
        });
        self.emitters.iter().map(|e| e.index).chain(colored).collect()
    }

    /// Returns a summary of the motion; `None` for a static scene.
    pub fn moves(&self) -> Option<Moves> {
        let count = |is_one: fn(&Body) -> bool| self.bodies.iter().filter(|b| is_one(b)).count();
        let played = |a: &Animation| PlayedAnimation { name: a.name.clone(), duration_s: a.duration_s };
        let lights = self.lights.iter().map(|l| l.index).chain(self.lamps.iter().map(|l| l.index));
        (!self.is_empty()).then(|| Moves {
            animations: self.animations.iter().map(played).collect(),
            nodes: self.nodes.len(),
            skins: self.skins.len(),
            rigid_instances: count(|b| !b.deforms()),
            skinned_instances: count(|b| b.skin.is_some()),
            morphing_instances: count(|b| !b.weights.is_empty()),
            lights: BTreeSet::from_iter(lights).len(),
            cameras: self.cameras.len(),
            materials: self.changing_materials().len(),
        })
    }
}

/// Joints of one skin that influence a vertex, with their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Influence {
    /// Indices into [`Skin::joints`]; 0 if the weight is 0.
    pub joints: [u16; 8],
    /// Nonnegative weights; they sum to 1.
    pub weights: [f32; 8],
}

/// Morph target: offsets that are scaled by a weight and added to a mesh. Each list has one offset per vertex, or is
/// empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Morph {
    pub positions: Vec<Vec3>,
    /// Added to unit normals; the sum is normalised.
    pub normals: Vec<Vec3>,
    /// Added to x, y and z of unit tangents; the sum is normalised.
    pub tangents: Vec<Vec3>,
}

#[cfg(test)]
mod tests;
