//! Evaluation of a motion at one time.

use glam::{Affine3A, DAffine3, DQuat, DVec3, Mat3, Vec3, Vec4};

use super::{Animation, Motion, Placement, Target};
use crate::scene::{Light, LightKind, Scene};

/// State of everything dynamic at one time: transforms, morph weights, colours and emission.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Transforms, one per node. A node whose transform exceeds the range of f32 takes that of its parent.
    pub world_from_node: Vec<DAffine3>,
    /// Morph weights, by body (see [`Motion::bodies`]), then by morph target.
    pub weights: Vec<Vec<f32>>,
    /// Animated base colours, as pairs of a material's index and its colour with components from 0 to 1.
    pub base_colors: Vec<(usize, Vec4)>,
    /// Animated emission, as pairs of a material's index and its radiance in W/(m² sr), nonnegative.
    pub emissive: Vec<(usize, Vec3)>,
    /// Animated strengths, as pairs of a light's index and its new [`Light::strength`], nonnegative.
    pub light_strengths: Vec<(usize, Vec3)>,
}

impl Animation {
    /// Returns the time within the animation, in seconds, at the scene's time `time_s`: wrapped around at the
    /// animation's duration if it `loops`, otherwise clamped to the duration.
    fn local_s(&self, time_s: f64, loops: bool) -> f64 {
        match self.duration_s > 0.0 && time_s.is_finite() {
            true if loops => time_s.rem_euclid(self.duration_s),
            true => time_s.clamp(0.0, self.duration_s),
            false => 0.0,
        }
    }
}

impl Motion {
    /// Evaluates all animations at `time_s` seconds. A time that is not finite counts as 0.
    pub fn pose(&self, time_s: f64) -> Pose {
        let mut rests: Vec<Placement> = self.nodes.iter().map(|n| n.rest).collect();
        let mut weights: Vec<Vec<f32>> = self.bodies.iter().map(|b| b.weights.clone()).collect();
        let (mut emitters, mut lamps) = (self.emitters.clone(), self.lamps.clone());
        let mut base_colors = Vec::new();
        for animation in &self.animations {
            let at_s = animation.local_s(time_s, self.loops);
            for channel in &animation.channels {
                let keys = &channel.keys;
                let numbers = || keys.at(at_s);
                let triple = || -> DVec3 { DVec3::from_array(first(numbers())) };
                let color = || triple().as_vec3().clamp(Vec3::ZERO, Vec3::MAX);
                let strength = || (first::<1>(numbers())[0] as f32).clamp(0.0, f32::MAX);
                match channel.target {
                    Target::Translation(node) => set(&mut rests, node, |t, _, _| *t = triple()),
                    Target::Rotation(node) => set(&mut rests, node, |_, r, _| *r = keys.rotation_at(at_s)),
                    Target::Scale(node) => set(&mut rests, node, |_, _, s| *s = triple()),
                    Target::Weights(node) => {
                        let now = numbers();
                        for (_, weights) in self.bodies.iter().zip(&mut weights).filter(|(body, _)| body.node == node) {
                            weights
                                .iter_mut()
                                .zip(&now)
                                .for_each(|(to, from)| *to = (*from as f32).clamp(-f32::MAX, f32::MAX));
                        }
                    }
                    Target::BaseColor(material) => {
                        let color = first::<4>(numbers()).map(|c| (c as f32).clamp(0.0, 1.0));
                        base_colors.push((material, Vec4::from_array(color)));
                    }
                    Target::EmissiveColor(i) => emitters.iter_mut().skip(i).take(1).for_each(|e| e.color = color()),
                    Target::EmissiveStrength(i) => {
                        emitters.iter_mut().skip(i).take(1).for_each(|e| e.strength = strength());
                    }
                    Target::LightColor(i) => lamps.iter_mut().skip(i).take(1).for_each(|l| l.color = color()),
                    Target::LightIntensity(i) => lamps.iter_mut().skip(i).take(1).for_each(|l| l.strength = strength()),
                }
            }
        }
        let product = |e: super::Emitter| (e.index, (e.color * e.strength).clamp(Vec3::ZERO, Vec3::MAX));
        Pose {
            world_from_node: self.world_from_nodes(&rests),
            weights,
            base_colors,
            emissive: emitters.into_iter().map(product).collect(),
            light_strengths: lamps.into_iter().map(product).collect(),
        }
    }

    fn world_from_nodes(&self, placements: &[Placement]) -> Vec<DAffine3> {
        let mut worlds: Vec<DAffine3> = Vec::with_capacity(self.nodes.len());
        for (node, placement) in self.nodes.iter().zip(placements) {
            let parent = node.parent.and_then(|p| worlds.get(p)).copied().unwrap_or(DAffine3::IDENTITY);
            let world = parent * placement.affine();
            let fits = world.to_cols_array().iter().all(|x| (*x as f32).is_finite());
            worlds.push(if fits { world } else { parent });
        }
        worlds
    }

    /// Returns the world transform of rigid body `body`, an index into [`Motion::bodies`]; the identity if out of
    /// range.
    pub fn world_from_body(&self, pose: &Pose, body: usize) -> DAffine3 {
        let node = self.bodies.get(body).and_then(|body| pose.world_from_node.get(body.node));
        node.copied().unwrap_or(DAffine3::IDENTITY)
    }

    /// Returns the matrices that transform a body's vertices to the world: one for each joint of its skin, or the
    /// transform of its node if it has no skin. `body` is an index into [`Motion::bodies`]; if it is out of range, the
    /// result is empty.
    pub fn joints(&self, pose: &Pose, body: usize) -> Vec<DAffine3> {
        let Some(body) = self.bodies.get(body) else { return Vec::new() };
        let world = |node: usize| pose.world_from_node.get(node).copied().unwrap_or(DAffine3::IDENTITY);
        match body.skin.and_then(|skin| self.skins.get(skin)) {
            None => vec![world(body.node)],
            Some(skin) => {
                skin.joints.iter().zip(&skin.inverse_bind).map(|(&joint, bind)| world(joint) * wide(bind)).collect()
            }
        }
    }

    /// Applies the pose to `scene`, which must be this motion's scene or a copy: transforms of rigid and morphed
    /// instances, lights, cameras and material values. Geometry does not change.
    pub fn place(&self, pose: &Pose, scene: &mut Scene) {
        let world = |node: usize| pose.world_from_node.get(node).copied().unwrap_or(DAffine3::IDENTITY);
        for body in self.bodies.iter().filter(|b| b.skin.is_none()) {
            if let Some(instance) = scene.instances.get_mut(body.instance) {
                instance.world_from_local = narrow(&world(body.node));
            }
        }
        for attached in &self.lights {
            if let Some(light) = scene.lights.get_mut(attached.index) {
                put_light(light, &world(attached.node));
            }
        }
        for attached in &self.cameras {
            if let Some(camera) = scene.cameras.get_mut(attached.index) {
                camera.world_from_view = without_scale(&world(attached.node)).unwrap_or(camera.world_from_view);
            }
        }
        for &(material, color) in &pose.base_colors {
            scene.materials.iter_mut().skip(material).take(1).for_each(|m| m.base_color = color);
        }
        for &(material, emissive) in &pose.emissive {
            scene.materials.iter_mut().skip(material).take(1).for_each(|m| m.emissive = emissive);
        }
        for &(light, strength) in &pose.light_strengths {
            scene.lights.iter_mut().skip(light).take(1).for_each(|l| l.strength = strength);
        }
    }
}

/// Returns the first `N` numbers, padded with 0.
fn first<const N: usize>(numbers: Vec<f64>) -> [f64; N] {
    let mut out = [0.0; N];
    out.iter_mut().zip(numbers).for_each(|(to, from)| *to = from);
    out
}

fn set(placements: &mut [Placement], node: usize, change: impl FnOnce(&mut DVec3, &mut DQuat, &mut DVec3)) {
    if let Some(Placement::Parts { translation, rotation, scale }) = placements.get_mut(node) {
        change(translation, rotation, scale);
    }
}

/// Moves a light to its node. If the node gives no direction, the light keeps its own.
fn put_light(light: &mut Light, world_from_node: &DAffine3) {
    let at = world_from_node.translation.as_vec3();
    let along = world_from_node.transform_vector3(DVec3::NEG_Z).try_normalize().map(DVec3::as_vec3);
    match &mut light.kind {
        LightKind::Point { position, .. } => *position = at,
        LightKind::Directional { direction, .. } => *direction = along.unwrap_or(*direction),
        LightKind::Spot { position, direction, .. } => {
            *position = at;
            *direction = along.unwrap_or(*direction);
        }
    }
}

/// Returns `transform` without scale, shear and mirroring. Returns `None` if a scale of 0 leaves no direction.
pub fn without_scale(transform: &DAffine3) -> Option<Affine3A> {
    let back = transform.matrix3.z_axis.try_normalize()?;
    let up = transform.matrix3.y_axis.try_normalize()?;
    let right = up.cross(back).try_normalize()?;
    let rotation = Mat3::from_cols(right.as_vec3(), back.cross(right).as_vec3(), back.as_vec3());
    Some(Affine3A::from_mat3_translation(rotation, transform.translation.as_vec3()))
}

/// Converts to f32, with rounding.
pub fn narrow(transform: &DAffine3) -> Affine3A {
    Affine3A::from_mat3_translation(transform.matrix3.as_mat3(), transform.translation.as_vec3())
}

/// Converts to f64 exactly.
pub fn wide(transform: &Affine3A) -> DAffine3 {
    DAffine3::from_mat3_translation(
        Mat3::from(transform.matrix3).as_dmat3(),
        Vec3::from(transform.translation).as_dvec3(),
    )
}
