//! What of a scene moves: a hierarchy of nodes, animations of it, and the surfaces, lights and cameras that hang on it.
//!
//! [`Motion::pose`] evaluates everything at one time in f64; [`Scene::at`](super::Scene::at) makes the still scene of that time. The methods
//! are those of glTF 2.0: sections 3.7.2.2 (morph targets), 3.7.3 (skins), 3.11 (animations) and appendix C
//! (interpolation).

pub mod keys;
pub mod play;
pub mod pose;
pub mod bake;

use glam::{Affine3A, DAffine3, DQuat, DVec3, Vec3};
use serde::Serialize;

use self::keys::Keys;

/// What of a scene moves. Empty: it stands still.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    /// Those that a body, a light or a camera depends on, parents before children.
    pub nodes: Vec<Node>,
    /// Those that are played, all at once. No two channels have one target.
    pub animations: Vec<Animation>,
    pub skins: Vec<Skin>,
    /// Instances that may move, each once.
    pub bodies: Vec<Body>,
    /// Lights on nodes: at the node's origin, shining along its −z.
    pub lights: Vec<Attached>,
    /// Cameras on nodes: at the node's origin, looking along its −z.
    pub cameras: Vec<Attached>,
    /// What animated materials emit at rest; `index` is one into [`Scene::materials`](super::Scene::materials).
    pub emitters: Vec<Emitter>,
    /// What animated lights emit at rest; `index` is one into [`Scene::lights`](super::Scene::lights).
    pub lamps: Vec<Emitter>,
    /// Whether animations begin anew after their end; else the end is held.
    pub loops: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// As in the file; may be empty.
    pub name: String,
    /// Index into [`Motion::nodes`], below the node's own.
    pub parent: Option<usize>,
    /// Its place in its parent where no animation says otherwise.
    pub rest: Placement,
}

/// A transform from a node to its parent, scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// Scales, then turns, then shifts. The rotation has unit length.
    Parts { translation: DVec3, rotation: DQuat, scale: DVec3 },
    /// Nothing animates it.
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
    /// Index into [`Motion::nodes`]. Its transform does not count if there is a skin.
    pub node: usize,
    /// Index into [`Motion::skins`]. The mesh has influences then, which name the skin's joints, and its instance's
    /// transform is the identity.
    pub skin: Option<usize>,
    /// Weights of the mesh's morphs at rest, as many as it has, or empty: no morphs count.
    pub weights: Vec<f32>,
}

impl Body {
    /// Whether its vertices move against one another.
    pub fn deforms(&self) -> bool {
        self.skin.is_some() || !self.weights.is_empty()
    }
}

/// A skeleton for a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// Indices into [`Motion::nodes`]; at least one.
    pub joints: Vec<usize>,
    /// From the mesh to each joint, as many as there are joints.
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

/// Emission as the product of two factors that are animated apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    pub index: usize,
    pub color: Vec3,
    pub strength: f32,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// As in the file; may be empty.
    pub name: String,
    pub channels: Vec<Channel>,
    /// From 0 on, and not before the last key. An animation of 0 s is a still.
    pub duration_s: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    pub target: Target,
    /// As wide as the target: 1 for strengths, 3, 4 for rotations (x, y, z, w) and base colours, or as many as there are
    /// weights.
    pub keys: Keys,
}

/// What a channel sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Target {
    /// Of a node with [`Placement::Parts`], by its index into [`Motion::nodes`]; so are the next two.
    Translation(usize),
    Rotation(usize),
    Scale(usize),
    /// Of all bodies of that node.
    Weights(usize),
    /// Of the material with that index into [`Scene::materials`](super::Scene::materials).
    BaseColor(usize),
    /// Of one of [`Motion::emitters`], by its index there; so is the next.
    EmissiveColor(usize),
    EmissiveStrength(usize),
    /// Of one of [`Motion::lamps`], by its index there; so is the next.
    LightColor(usize),
    LightIntensity(usize),
}

/// How much of a scene moves.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Moves {
    /// Animations that are played.
    pub animations: Vec<PlayedAnimation>,
    /// The number of nodes that are animated or below such nodes, or on the way to them.
    pub nodes: usize,
    /// Skeletons in use.
    pub skins: usize,
    /// Instances that follow a node without changing their shape.
    pub rigid_instances: usize,
    /// Instances with a skin.
    pub skinned_instances: usize,
    /// Instances whose morph targets are animated, or may have weights.
    pub morphing_instances: usize,
    /// Lights that move or change their strength.
    pub lights: usize,
    pub cameras: usize,
    /// Materials that change.
    pub materials: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PlayedAnimation {
    pub name: String,
    pub duration_s: f64,
}

impl Motion {
    /// Whether the scene stands still.
    pub fn is_empty(&self) -> bool {
        let Self { bodies, lights, cameras, animations, .. } = self;
        bodies.is_empty() && lights.is_empty() && cameras.is_empty() && animations.is_empty()
    }

    /// When the last of the animations ends for the first time, seconds.
    pub fn duration_s(&self) -> f64 {
        self.animations.iter().map(|a| a.duration_s).fold(0.0, f64::max)
    }

    /// `None` where nothing moves.
    pub fn moves(&self) -> Option<Moves> {
        let count = |is_one: fn(&Body) -> bool| self.bodies.iter().filter(|b| is_one(b)).count();
        let played = |a: &Animation| PlayedAnimation { name: a.name.clone(), duration_s: a.duration_s };
        let distinct = |indices: Vec<usize>| std::collections::BTreeSet::from_iter(indices).len();
        let lights = self.lights.iter().map(|l| l.index).chain(self.lamps.iter().map(|l| l.index)).collect();
        let colored = self.animations.iter().flat_map(|a| &a.channels).filter_map(|channel| match channel.target {
            Target::BaseColor(material) => Some(material),
            _ => None,
        });
        let materials = self.emitters.iter().map(|e| e.index).chain(colored).collect();
        (!self.is_empty()).then(|| Moves {
            animations: self.animations.iter().map(played).collect(),
            nodes: self.nodes.len(),
            skins: self.skins.len(),
            rigid_instances: count(|b| !b.deforms()),
            skinned_instances: count(|b| b.skin.is_some()),
            morphing_instances: count(|b| !b.weights.is_empty()),
            lights: distinct(lights),
            cameras: self.cameras.len(),
            materials: distinct(materials),
        })
    }
}

/// Joints in one skin that move a vertex, and by which share.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Influence {
    /// Indices into [`Skin::joints`]; 0 where the weight is 0.
    pub joints: [u16; 8],
    /// From 0 on; they sum to 1.
    pub weights: [f32; 8],
}

/// Offsets that a weight multiplies and adds to a mesh: each one per position, or empty for none.
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
