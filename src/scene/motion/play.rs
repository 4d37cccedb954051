//! What of a scene file's animations is played, and what moves besides.

use glam::{DQuat, DVec3, Vec3};

use super::keys::{Interpolation, Keys};
use super::{Animation, Attached, Channel, Node, Placement, Target};
use crate::scene::{LightKind, Scene};

/// Which animations of a scene file are played.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// All together.
    #[default]
    All,
    None,
    /// The first of that name.
    Named(String),
}

impl Choice {
    /// `all`, `none`, or a name.
    pub fn of(text: &str) -> Self {
        match text {
            "all" => Self::All,
            "none" => Self::None,
            name => Self::Named(name.to_owned()),
        }
    }

    pub fn text(&self) -> &str {
        match self {
            Self::All => "all",
            Self::None => "none",
            Self::Named(name) => name,
        }
    }
}

/// What is to move.
#[derive(Clone, Debug, PartialEq)]
pub struct Play {
    pub animation: Choice,
    /// Whether animations begin anew after their end; else the end is held.
    pub loops: bool,
    pub moves: Vec<Move>,
}

impl Default for Play {
    /// All of the file's animations, over and over.
    fn default() -> Self {
        Self { animation: Choice::All, loops: true, moves: Vec::new() }
    }
}

/// What a move is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Moved {
    /// The first node of that name in the scene's file.
    Node(String),
    /// One of the shot's own lights, by its number.
    Light(usize),
}

/// A node or light that moves by keys of its own, linear between them. They go before the file's animations.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    pub of: Moved,
    /// At least one; times from 0 on that strictly rise, each of them one that an f32 holds apart from the others.
    pub keys: Vec<MoveKey>,
}

/// A place in the parent. What is `None` in the first key is so in all, and stays as it is in the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoveKey {
    pub time_s: f64,
    /// Scene units.
    pub position: Option<DVec3>,
    /// Turns around x, then y, then z of the parent, degrees.
    pub rotation_deg: Option<DVec3>,
    pub scale: Option<DVec3>,
}

impl MoveKey {
    fn rotation(&self) -> Option<DQuat> {
        let [x, y, z] = self.rotation_deg?.to_array().map(f64::to_radians);
        Some(DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x))
    }
}

impl Move {
    /// Its channels, of a node by that index.
    pub fn channels(&self, node: usize) -> Vec<Channel> {
        let keys = |width, of: &dyn Fn(&MoveKey) -> Option<Vec<f64>>| {
            let values: Vec<f32> = self.keys.iter().filter_map(of).flatten().map(|v| v as f32).collect();
            let times_s = self.keys.iter().map(|k| k.time_s as f32).collect();
            Keys::new(times_s, values, width, Interpolation::Linear).ok()
        };
        let triple = |v: DVec3| v.to_array().to_vec();
        let channels = [
            (Target::Translation(node), keys(3, &|k| k.position.map(triple))),
            (Target::Rotation(node), keys(4, &|k| k.rotation().map(|q| q.to_array().to_vec()))),
            (Target::Scale(node), keys(3, &|k| k.scale.map(triple))),
        ];
        channels.into_iter().filter_map(|(target, keys)| Some(Channel { target, keys: keys? })).collect()
    }
}

impl Play {
    /// Lets the shot's own lights move, the first of which has the index `first` in the scene.
    pub fn move_lights(&self, scene: &mut Scene, first: usize) {
        let mut channels = Vec::new();
        let motion = &mut scene.motion;
        for one in &self.moves {
            let Moved::Light(number) = one.of else { continue };
            let Some(light) = scene.lights.get(first + number) else { continue };
            let node = motion.nodes.len();
            motion.nodes.push(Node { name: String::new(), parent: None, rest: place_of(&light.kind) });
            motion.lights.push(Attached { index: first + number, node });
            channels.extend(one.channels(node));
        }
        if !channels.is_empty() {
            motion.loops = self.loops;
            motion.animations.push(self.animation_of(channels));
            let motion = motion.clone();
            motion.place(&motion.pose(0.0), scene);
        }
    }

    /// Moves as an animation. All of them last as long as the longest.
    pub fn animation_of(&self, channels: Vec<Channel>) -> Animation {
        let ends = self.moves.iter().filter_map(|m| m.keys.last()).map(|k| f64::from(k.time_s as f32));
        Animation { name: String::new(), channels, duration_s: ends.fold(0.0, f64::max) }
    }
}

/// Where a light's node is that shines along its −z.
fn place_of(light: &LightKind) -> Placement {
    let towards = |direction: Vec3| {
        let direction = direction.as_dvec3().try_normalize().unwrap_or(DVec3::NEG_Z);
        DQuat::from_rotation_arc(DVec3::NEG_Z, direction)
    };
    let (position, rotation) = match *light {
        LightKind::Point { position, .. } => (position, DQuat::IDENTITY),
        LightKind::Directional { direction, .. } => (Vec3::ZERO, towards(direction)),
        LightKind::Spot { position, direction, .. } => (position, towards(direction)),
    };
    Placement::Parts { translation: position.as_dvec3(), rotation, scale: DVec3::ONE }
}
