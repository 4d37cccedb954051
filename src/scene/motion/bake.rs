//! Bakes a dynamic scene at one time into a static scene.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::{Influence, Morph, Motion};
use crate::scene::{Mesh, Scene};

impl Scene {
    /// Returns the static scene at `time_s` seconds. Vertices are morphed and skinned in f64 and then rounded. Images
    /// are shared with this scene. A static scene is copied.
    pub fn at(&self, time_s: f64) -> Scene {
        let (motion, pose) = (&self.motion, self.motion.pose(time_s));
        let mut still = Scene { motion: Motion::default(), ..self.clone() };
        motion.place(&pose, &mut still);
        let mut uses = vec![0usize; self.meshes.len()];
        for instance in &self.instances {
            uses[instance.mesh] += 1;
        }
        for (index, body) in motion.bodies.iter().enumerate().filter(|(_, body)| body.deforms()) {
            let Some(instance) = still.instances.get_mut(body.instance) else { continue };
            let weights = pose.weights.get(index).map_or(&[][..], Vec::as_slice);
            let joints = body.skin.map(|_| motion.joints(&pose, index));
            let shape = deformed(&self.meshes[instance.mesh], weights, joints.as_deref());
            // If all instances of a mesh deform, the last one replaces the mesh. All others get a mesh of their own.
            uses[instance.mesh] -= 1;
            if uses[instance.mesh] == 0 {
                still.meshes[instance.mesh] = shape;
            } else {
                instance.mesh = still.meshes.len();
                still.meshes.push(shape);
            }
        }
        for mesh in &mut still.meshes {
            (mesh.influences, mesh.morphs) = (Vec::new(), Vec::new());
        }
        still
    }

    /// Returns an upper bound on the bytes that [`Scene::at`] takes.
    pub fn bytes_at(&self) -> u64 {
        let shape = |mesh: &Mesh| mesh.bytes() - mesh.motion_bytes();
        let bodies = self.motion.bodies.iter().filter(|b| b.deforms()).filter_map(|b| self.instances.get(b.instance));
        let shapes: u64 = bodies.map(|i| shape(&self.meshes[i.mesh])).sum();
        shapes + self.meshes.iter().map(Mesh::bytes).sum::<u64>() + size_of_val(&self.instances[..]) as u64
    }
}

/// Returns the mesh with its weighted morphs added and then, if there are joints, skinned to world space, all in f64.
/// The result has neither influences nor morphs.
pub fn deformed(mesh: &Mesh, weights: &[f32], joints: Option<&[DAffine3]>) -> Mesh {
    let mut shape = Mesh {
        uvs: mesh.uvs.clone(),
        colors: mesh.colors.clone(),
        triangles: mesh.triangles.clone(),
        material: mesh.material,
        ..Mesh::default()
    };
    let is_mirrored = joints.is_some_and(is_mirrored);
    if is_mirrored {
        shape.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    let handedness = if is_mirrored { -1.0 } else { 1.0 };
    let active: Vec<(f64, &Morph)> =
        weights.iter().map(|w| f64::from(*w)).zip(&mesh.morphs).filter(|(w, _)| *w != 0.0).collect();
    let offset = |list: fn(&Morph) -> &Vec<Vec3>, i: usize| -> DVec3 {
        active.iter().filter_map(|(w, morph)| Some(*w * list(morph).get(i)?.as_dvec3())).sum()
    };
    for (i, position) in mesh.positions.iter().enumerate() {
        let to_world = joints.map(|joints| blend(joints, mesh.influences.get(i)));
        let linear = to_world.map_or(DMat3::IDENTITY, |m| m.matrix3);
        let position = position.as_dvec3() + offset(|m| &m.positions, i);
        let position = to_world.map_or(position, |m| m.transform_point3(position));
        shape.positions.push(position.clamp(DVec3::splat(-MOST), DVec3::splat(MOST)).as_vec3());
        if let Some(&rest) = mesh.normals.get(i) {
            let normal = rest.as_dvec3() + offset(|m| &m.normals, i);
            let normal = handedness * (cofactor(&linear) * normal.normalize_or(rest.as_dvec3()));
            shape.normals.push(normal.try_normalize().map_or(rest, DVec3::as_vec3));
        }
        if let Some(&rest) = mesh.tangents.get(i) {
            let tangent = rest.truncate().as_dvec3();
            // A zero tangent marks a vertex without a normal map.
            let tangent = if tangent == DVec3::ZERO { tangent } else { tangent + offset(|m| &m.tangents, i) };
            let tangent = (linear * tangent).normalize_or_zero().as_vec3();
            shape.tangents.push(tangent.extend(rest.w * handedness as f32));
        }
    }
    shape
}

const MOST: f64 = f32::MAX as f64;

/// Returns true if the transforms of most joints mirror (negative determinant). Triangles are then wound in reverse,
/// like those of a mirrored instance.
pub fn is_mirrored(joints: &[DAffine3]) -> bool {
    joints.iter().filter(|j| j.matrix3.determinant() < 0.0).count() * 2 > joints.len()
}

/// Returns a vertex's skinning matrix. A vertex without influences follows the first joint.
fn blend(joints: &[DAffine3], influence: Option<&Influence>) -> DAffine3 {
    let joint = |index: usize| joints.get(index).copied().unwrap_or(DAffine3::IDENTITY);
    let Some(influence) = influence else { return joint(0) };
    let mut sum = DAffine3::ZERO;
    for (&index, &weight) in influence.joints.iter().zip(&influence.weights).filter(|(_, weight)| **weight != 0.0) {
        let (joint, weight) = (joint(index.into()), f64::from(weight));
        sum.matrix3 += joint.matrix3 * weight;
        sum.translation += joint.translation * weight;
    }
    sum
}

/// Returns the cofactor matrix: the inverse transpose up to a factor, defined for singular transforms as well.
fn cofactor(linear: &DMat3) -> DMat3 {
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = *linear;
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}
