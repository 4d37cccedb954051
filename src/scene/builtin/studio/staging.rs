//! Assembly of dynamic scenes: nodes, the meshes attached to them, and the channels of one looping animation.

use glam::{Affine3A, DQuat, DVec3};

use super::assembly::Assembly;
use super::maths::sin_cos;
use crate::scene::Scene;
use crate::scene::motion::keys::{Interpolation, Keys};
use crate::scene::motion::{Animation, Body, Channel, Motion, Node, Placement, Skin, Target};

/// Period of the animation, seconds.
pub const PERIOD_S: f64 = 4.0;

/// A dynamic scene under construction.
pub struct Staging {
    pub still: Assembly,
    pub motion: Motion,
    channels: Vec<Channel>,
}

impl Staging {
    pub fn new(name: &str) -> Self {
        let motion = Motion { loops: true, ..Motion::default() };
        Self { still: Assembly::new(name), motion, channels: Vec::new() }
    }

    /// Adds a node with this transform relative to its parent. Returns its index.
    pub fn node(&mut self, name: &str, parent: Option<usize>, translation: DVec3, rotation: DQuat) -> usize {
        let rest = Placement::Parts { translation, rotation, scale: DVec3::ONE };
        self.motion.nodes.push(Node { name: name.to_owned(), parent, rest });
        self.motion.nodes.len() - 1
    }

    /// Attaches a mesh to a node.
    pub fn hang(&mut self, mesh: usize, node: usize) {
        self.body(mesh, node, None, Vec::new());
    }

    /// Skins a mesh. `joints` are indices of nodes, and `positions` are the joints' positions in the space of the mesh.
    pub fn dress(&mut self, mesh: usize, joints: Vec<usize>, positions: &[DVec3]) {
        let inverse_bind = positions.iter().map(|p| Affine3A::from_translation(-p.as_vec3())).collect();
        let node = joints.first().copied().unwrap_or(0);
        self.motion.skins.push(Skin { joints, inverse_bind });
        self.body(mesh, node, Some(self.motion.skins.len() - 1), Vec::new());
    }

    pub fn body(&mut self, mesh: usize, node: usize, skin: Option<usize>, weights: Vec<f32>) {
        let instance = self.still.instance(mesh, Affine3A::IDENTITY);
        self.motion.bodies.push(Body { instance, node, skin, weights });
    }

    /// Adds a linearly interpolated channel, with keys at equal steps from 0 to [`PERIOD_S`]. `of` maps a time in
    /// seconds, at least 0 and below the period, to a value.
    pub fn sampled<const N: usize>(&mut self, target: Target, steps: u32, of: impl Fn(f64) -> [f64; N]) {
        let time_s = |step: u32| PERIOD_S * f64::from(step) / f64::from(steps);
        let times = (0..=steps).map(time_s).collect();
        let values = (0..=steps).flat_map(|step| of(time_s(step % steps))).collect();
        self.channel(target, N, times, values, Interpolation::Linear);
    }

    /// Adds a channel of one number with step interpolation.
    pub fn switched(&mut self, target: Target, times_s: &[f64], values: &[f64]) {
        self.channel(target, 1, times_s.to_vec(), values.to_vec(), Interpolation::Step);
    }

    fn channel(&mut self, target: Target, width: usize, times: Vec<f64>, values: Vec<f64>, kind: Interpolation) {
        let [times, values] = [times, values].map(|list| list.into_iter().map(|v| v as f32).collect());
        self.channels.extend(Keys::new(times, values, width, kind).ok().map(|keys| Channel { target, keys }));
    }

    /// Returns the scene at time 0, with its motion.
    pub fn finish(self) -> Scene {
        let Self { still, mut motion, channels } = self;
        let mut scene = still.finish();
        motion.animations.push(Animation { name: scene.name.clone(), channels, duration_s: PERIOD_S });
        motion.place(&motion.pose(0.0), &mut scene);
        scene.motion = motion;
        scene
    }
}

/// Returns sine and cosine of an angle that is given in full turns.
pub fn wave(turns: f64) -> (f64, f64) {
    let (sin, cos) = sin_cos((turns.fract() * std::f64::consts::TAU) as f32);
    (sin.into(), cos.into())
}

/// Returns a rotation about a unit axis.
pub fn turned(axis: DVec3, angle_rad: f64) -> DQuat {
    let (sin, cos) = wave(angle_rad / (2.0 * std::f64::consts::TAU));
    DQuat::from_xyzw(axis.x * sin, axis.y * sin, axis.z * sin, cos).normalize()
}
