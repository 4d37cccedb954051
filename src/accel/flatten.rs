//! Instances to one list of world-space triangles.

use glam::{Mat3, Vec2, Vec3};

use super::{Shading, TRIANGLE_ALPHA, Triangle};
use crate::scene::{AlphaMode, Instance, Material, Mesh, Scene};

pub(super) struct Flat {
    pub triangles: Vec<Triangle>,
    pub shadings: Vec<Shading>,
    /// Per triangle; empty when no mesh has colours.
    pub colors: Vec<[[f32; 4]; 3]>,
    /// Per triangle; empty when no texture is on coordinate set 1.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Per triangle; empty when no mesh has tangents.
    pub tangents: Vec<[[f32; 4]; 3]>,
    pub dropped: usize,
}

/// Which attributes the scene has at all: an array is full or empty.
struct Present {
    colors: bool,
    second_uvs: bool,
    tangents: bool,
}

pub(super) fn flatten(scene: &Scene) -> Flat {
    let any = |has: fn(&Mesh) -> bool| scene.instances.iter().any(|i| has(&scene.meshes[i.mesh]));
    let present = Present {
        colors: any(|m| !m.colors.is_empty()),
        second_uvs: scene.instances.iter().any(|i| scene.materials[scene.meshes[i.mesh].material].uses_uv_set(1)),
        tangents: any(|m| !m.tangents.is_empty()),
    };
    let count = scene.triangle_count();
    let room = |present: bool| if present { count } else { 0 };
    let mut flat = Flat {
        triangles: Vec::with_capacity(count),
        shadings: Vec::with_capacity(count),
        colors: Vec::with_capacity(room(present.colors)),
        second_uvs: Vec::with_capacity(room(present.second_uvs)),
        tangents: Vec::with_capacity(room(present.tangents)),
        dropped: 0,
    };
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        push_instance(&mut flat, instance, mesh, &scene.materials[mesh.material], &present);
    }
    flat
}

fn push_instance(flat: &mut Flat, instance: &Instance, mesh: &Mesh, material: &Material, present: &Present) {
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
    // A mirrored frame is left-handed: the bitangent's sign turns with it.
    let handedness = if mirrored { -1.0 } else { 1.0 };
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
        let uvs = |set: usize| corner.map(|i| mesh.uvs[set].get(i).copied().unwrap_or(Vec2::ZERO));
        let [t0, t1, t2] = uvs(0);
        flat.triangles.push(Triangle { v0, material: mesh.material as u32, v1, flags, v2, light: 0 });
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
        if present.colors {
            flat.colors.push(corner.map(|i| mesh.colors.get(i).map_or([1.0; 4], |c| c.to_array())));
        }
        if present.second_uvs {
            flat.second_uvs.push(uvs(1).map(|uv| uv.to_array()));
        }
        if present.tangents {
            flat.tangents.push(corner.map(|i| match mesh.tangents.get(i) {
                Some(t) => {
                    let tangent = (linear * t.truncate()).normalize_or_zero();
                    tangent.extend(t.w * handedness).to_array()
                }
                None => [0.0; 4],
            }));
        }
    }
}
