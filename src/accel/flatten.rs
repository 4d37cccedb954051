//! Instances to one list of world-space triangles.

use glam::{Affine3A, DVec3, Mat3, Vec2, Vec3};

use super::{Shading, TRIANGLE_ALPHA, Triangle};
use crate::scene::{AlphaMode, Instance, Material, Mesh, Scene};

pub(super) struct Flat {
    pub triangles: Vec<Triangle>,
    pub shadings: Vec<Shading>,
    /// Per triangle; empty when no mesh has colours.
    pub colors: Vec<[[f32; 4]; 3]>,
    pub dropped: usize,
}

/// Positions are relative to `origin`.
pub(super) fn flatten(scene: &Scene, origin: DVec3) -> Flat {
    let count = scene.triangle_count();
    let has_colors = scene.instances.iter().any(|i| !scene.meshes[i.mesh].colors.is_empty());
    let mut flat = Flat {
        triangles: Vec::with_capacity(count),
        shadings: Vec::with_capacity(count),
        colors: Vec::with_capacity(if has_colors { count } else { 0 }),
        dropped: 0,
    };
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        let place = &instance.world_from_local;
        let translation = Vec3::from(place.translation).as_dvec3() - origin;
        let near_from_local = Affine3A { translation: translation.as_vec3a(), ..*place };
        let instance = &Instance { world_from_local: near_from_local, ..*instance };
        push_instance(&mut flat, instance, mesh, &scene.materials[mesh.material], has_colors);
    }
    flat
}

fn push_instance(flat: &mut Flat, instance: &Instance, mesh: &Mesh, material: &Material, has_colors: bool) {
    let linear = Mat3::from(instance.world_from_local.matrix3);
    let mirrored = linear.determinant() < 0.0;
    // The cofactor matrix: the inverse transpose up to a factor, defined for flattened (singular) transforms too.
    let cofactor = Mat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    ) * if mirrored { -1.0 } else { 1.0 };
    let world: Vec<Vec3> = mesh.positions.iter().map(|&p| instance.world_from_local.transform_point3(p)).collect();
    let flags = if material.alpha_mode == AlphaMode::Opaque { 0 } else { TRIANGLE_ALPHA };
    let uv_set = material.base_color_texture.or(material.emissive_texture).map_or(0, |t| t.uv_set);
    let uvs = &mesh.uvs[uv_set];
    for &[a, b, c] in &mesh.triangles {
        // A mirrored triangle winds the other way round.
        let corner = if mirrored { [a, c, b] } else { [a, b, c] }.map(|i| i as usize);
        let [v0, v1, v2] = corner.map(|i| world[i]);
        let cross = (v1 - v0).cross(v2 - v0);
        if !(cross.length() > 0.0 && cross.is_finite()) {
            flat.dropped += 1;
            continue;
        }
        let normal = cross.normalize();
        let [n0, n1, n2] = corner.map(|i| match mesh.normals.get(i) {
            Some(&n) => (cofactor * n).try_normalize().unwrap_or(normal),
            None => normal,
        });
        let [t0, t1, t2] = corner.map(|i| uvs.get(i).copied().unwrap_or(Vec2::ZERO));
        flat.triangles.push(Triangle { v0, material: mesh.material as u32, v1, flags, v2, pad: 0 });
        flat.shadings.push(Shading {
            n0,
            u0: t0.x,
            n1,
            v0: t0.y,
            n2,
            u1: t1.x,
            v1: t1.y,
            u2: t2.x,
            v2: t2.y,
            pad: 0.0,
        });
        if has_colors {
            flat.colors.push(corner.map(|i| mesh.colors.get(i).map_or([1.0; 4], |c| c.to_array())));
        }
    }
}
