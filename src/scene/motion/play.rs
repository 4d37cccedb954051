//! Playback settings: the animations of a scene file to play, and the moves (`[[move]]`) of a shot.

use glam::{DQuat, DVec3, Vec3};

use super::keys::{Interpolation, Keys};
use super::{Animation, Attached, Channel, Node, Placement, Target};
use crate::scene::{LightKind, Scene};

/// Choice of a scene file's animations.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// All animations together.
    #[default]
    All,
    None,
    /// The first animation of that name.
    Named(String),
}

impl Choice {
    /// Parses `all`, `none`, or a name.
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

/// Animations and moves to play.
#[derive(Clone, Debug, PartialEq)]
pub struct Play {
    pub animation: Choice,
    /// True if animations loop; otherwise each one stays at its end.
    pub loops: bool,
    pub moves: Vec<Move>,
}

impl Default for Play {
    /// Loops all of the file's animations.
    fn default() -> Self {
        Self { animation: Choice::All, loops: true, moves: Vec::new() }
    }
}

/// Object that a move animates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Moved {
    /// First node of that name in the scene's file.
    Node(String),
    /// One of the shot's own lights, by index.
    Light(usize),
}

/// Linearly interpolated keys of a node or light. They override the file's animations.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    pub of: Moved,
    /// Keys, at least one, at nonnegative, strictly increasing times that are distinct as f32.
    pub keys: Vec<MoveKey>,
}

/// Transform to the parent. Components that are `None` in the first key are `None` in all, and keep their value from
/// the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoveKey {
    pub time_s: f64,
    /// Position in scene units.
    pub position: Option<DVec3>,
    /// Rotation around the parent's x, then y, then z, degrees.
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
    /// Returns the move's channels for the node with that index.
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
    /// Animates the shot's own lights. `first` is the index of the first of them in the scene.
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

    /// Returns the moves' channels as an animation, as long as the longest move.
    pub fn animation_of(&self, channels: Vec<Channel>) -> Animation {
        let ends = self.moves.iter().filter_map(|m| m.keys.last()).map(|k| f64::from(k.time_s as f32));
        Animation { name: String::new(), channels, duration_s: ends.fold(0.0, f64::max) }
    }
}

/// Returns the placement of a light's node, along whose −z the light shines.
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
