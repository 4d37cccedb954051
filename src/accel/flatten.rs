//! Flattens instances to one list of world-space triangles, or a mesh to a list in its local space.

use glam::{Affine3A, DVec3, Mat3, Vec2, Vec3};

use super::triangle::{Shading, TRIANGLE_ALPHA, Triangle};
use crate::scene::{AlphaMode, Instance, Material, Mesh, Scene};

#[derive(Default)]
pub(super) struct Flat {
    pub triangles: Vec<Triangle>,
    pub shadings: Vec<Shading>,
    /// Colours per triangle; empty if no mesh has colours.
    pub colors: Vec<[[f32; 4]; 3]>,
    /// Texture coordinate set 1 per triangle; empty if no texture uses it.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Tangents per triangle; empty if no mesh has tangents.
    pub tangents: Vec<[[f32; 4]; 3]>,
    pub dropped: usize,
}

/// Optional vertex attributes that the scene has. The list of an attribute has an entry for every triangle or none at
/// all.
#[derive(Clone, Copy)]
pub(super) struct Present {
    colors: bool,
    second_uvs: bool,
    tangents: bool,
}

impl Present {
    pub fn of(scene: &Scene) -> Self {
        let any = |has: fn(&Mesh) -> bool| scene.instances.iter().any(|i| has(&scene.meshes[i.mesh]));
        Self {
            colors: any(|m| !m.colors.is_empty()),
            second_uvs: scene.instances.iter().any(|i| scene.materials[scene.meshes[i.mesh].material].uses_uv_set(1)),
            tangents: any(|m| !m.tangents.is_empty()),
        }
    }

    /// Returns the bytes of one triangle across all tables.
    pub fn row_bytes(&self) -> usize {
        let tables = [
            (true, size_of::<Triangle>() + size_of::<Shading>()),
            (self.colors, size_of::<[[f32; 4]; 3]>()),
            (self.second_uvs, size_of::<[[f32; 2]; 3]>()),
            (self.tangents, size_of::<[[f32; 4]; 3]>()),
        ];
        tables.iter().filter(|(is_there, _)| *is_there).map(|(_, bytes)| bytes).sum()
    }
}

/// Returns an instance's transform with its translation relative to `origin`.
pub(super) fn near_from_local(instance: &Instance, origin: DVec3) -> Affine3A {
    let translation = Vec3::from(instance.world_from_local.translation).as_dvec3() - origin;
    Affine3A { translation: translation.as_vec3a(), ..instance.world_from_local }
}

/// Flattens these instances to world space. Positions are relative to `origin`.
pub(super) fn flatten<'a>(
    scene: &Scene,
    instances: impl Iterator<Item = &'a Instance>,
    origin: DVec3,
    present: &Present,
) -> Flat {
    let mut flat = Flat::default();
    for instance in instances {
        let mesh = &scene.meshes[instance.mesh];
        let place = near_from_local(instance, origin);
        let mirrored = place.matrix3.determinant() < 0.0;
        push_instance(&mut flat, &place, mirrored, mesh, &scene.materials[mesh.material], present, false);
    }
    flat
}

/// Flattens the shape of a deforming body to world space. Keeps degenerate triangles, since they may have an area in
/// other frames.
pub(super) fn deforming(scene: &Scene, shape: &Mesh, origin: DVec3, present: &Present) -> Flat {
    let mut flat = Flat::default();
    let place = Affine3A::from_translation(-origin.as_vec3());
    push_instance(&mut flat, &place, false, shape, &scene.materials[shape.material], present, true);
    flat
}

/// Flattens a mesh in its local space, for instances that are all mirrored or all not. Triangles are counter-clockwise
/// in world space, and the inverse transpose maps normals to world space.
pub(super) fn local(scene: &Scene, mesh: usize, mirrored: bool, present: &Present) -> Flat {
    let mut flat = Flat::default();
    let mesh = &scene.meshes[mesh];
    let material = &scene.materials[mesh.material];
    push_instance(&mut flat, &Affine3A::IDENTITY, mirrored, mesh, material, present, false);
    if mirrored {
        // Restores the normals, which `push_instance` has negated as for a mirrored transform.
        flat.shadings.iter_mut().for_each(|s| [s.n0, s.n1, s.n2] = [-s.n0, -s.n1, -s.n2]);
    }
    flat
}

fn push_instance(
    flat: &mut Flat,
    place: &Affine3A,
    mirrored: bool,
    mesh: &Mesh,
    material: &Material,
    present: &Present,
    keeps_all: bool,
) {
    let linear = Mat3::from(place.matrix3);
    // The cofactor matrix: the inverse transpose up to a factor, defined for flattened (singular) transforms too.
    let cofactor = Mat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    ) * if mirrored { -1.0 } else { 1.0 };
    let world: Vec<Vec3> = mesh.positions.iter().map(|&p| place.transform_point3(p)).collect();
    let first_copy = if material.alpha_mode == AlphaMode::Opaque { 0 } else { TRIANGLE_ALPHA };
    // A mirrored frame is left-handed, so the bitangent's sign flips.
    let handedness = if mirrored { -1.0 } else { 1.0 };
    for &[a, b, c] in &mesh.triangles {
        // Mirroring reverses a triangle's winding.
        let corner = if mirrored { [a, c, b] } else { [a, b, c] }.map(|i| i as usize);
        let [v0, v1, v2] = corner.map(|i| world[i]);
        let cross = (v1 - v0).cross(v2 - v0);
        let has_area = cross.length() > 0.0 && cross.is_finite();
        if !(has_area || keeps_all) {
            flat.dropped += 1;
            continue;
        }
        let normal = cross.normalize_or(Vec3::Z);
        let [n0, n1, n2] = corner.map(|i| match mesh.normals.get(i) {
            Some(&n) => (cofactor * n).try_normalize().unwrap_or(normal),
            None => normal,
        });
        let uvs = |set: usize| corner.map(|i| mesh.uvs[set].get(i).copied().unwrap_or(Vec2::ZERO));
        let [t0, t1, t2] = uvs(0);
        flat.triangles.push(Triangle { v0, material: mesh.material as u32, v1, first_copy, v2, light: 0 });
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

#[cfg(test)]
mod tests {
    use glam::{Affine2, Affine3A, Quat, Vec4};

    use super::*;
    use crate::scene::{NormalMap, TextureRef};

    fn flatten(scene: &Scene) -> Flat {
        super::flatten(scene, scene.instances.iter(), DVec3::ZERO, &Present::of(scene))
    }

    /// Returns a triangle with a different tangent frame at each corner, and a triangle without attributes.
    fn scene(world_from_local: Affine3A, uv_set: usize) -> Scene {
        let texture = TextureRef { texture: 0, uv_set, uv_from_uv: Affine2::IDENTITY };
        let mapped = Material { normal_map: Some(NormalMap { texture, scale: 1.0 }), ..Material::default() };
        let bare =
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let framed = Mesh {
            normals: vec![Vec3::Z, Vec3::Z, Vec3::new(0.6, 0.0, 0.8)],
            tangents: vec![
                Vec4::new(1.0, 0.0, 0.0, 1.0),
                Vec4::new(0.0, 1.0, 0.0, -1.0),
                Vec4::new(0.8, 0.0, -0.6, 1.0),
            ],
            uvs: [vec![], vec![Vec2::X, Vec2::Y, Vec2::ONE]],
            ..bare.clone()
        };
        let instance = |mesh| Instance { mesh, world_from_local };
        Scene {
            meshes: vec![framed, Mesh { material: 1, ..bare }],
            instances: vec![instance(0), instance(1)],
            materials: vec![mapped, Material::default()],
            ..Scene::empty("two triangles")
        }
    }

    fn bitangent(normal: Vec3, tangent: [f32; 4]) -> Vec3 {
        let tangent = Vec4::from_array(tangent);
        normal.cross(tangent.truncate()) * tangent.w
    }

    #[test]
    fn frames_turn_stretch_and_mirror_with_their_instance() {
        let still = flatten(&scene(Affine3A::IDENTITY, 1));
        for scale in [Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0), Vec3::new(2.0, 2.0, -2.0), Vec3::splat(-3.0)] {
            let turn = Quat::from_rotation_y(0.7) * Quat::from_rotation_z(-0.4);
            let world = Affine3A::from_scale_rotation_translation(scale, turn, Vec3::ONE);
            let flat = flatten(&scene(world, 1));
            let corners = if scale.element_product() < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
            let normals = |f: &Flat| [f.shadings[0].n0, f.shadings[0].n1, f.shadings[0].n2];
            for (now, before) in corners.into_iter().enumerate() {
                let (n, t) = (normals(&flat)[now], flat.tangents[0][now]);
                let (n0, t0) = (normals(&still)[before], still.tangents[0][before]);
                let moved = |v: Vec3| world.transform_vector3(v).normalize();
                assert!(Vec4::from_array(t).truncate().distance(moved(Vec4::from_array(t0).truncate())) < 1e-6);
                assert!(n.distance(moved(n0)) < 1e-6);
                assert!(bitangent(n, t).distance(moved(bitangent(n0, t0))) < 1e-6, "{scale} {now}");
                assert_eq!(flat.second_uvs[0][now], still.second_uvs[0][before]);
            }
        }
    }

    #[test]
    fn tangents_stay_perpendicular_under_uneven_scale() {
        let flat = flatten(&scene(Affine3A::from_scale(Vec3::new(5.0, 1.0, 0.5)), 1));
        let (n, t) = (flat.shadings[0].n2, Vec4::from_array(flat.tangents[0][2]).truncate());
        assert!(n.dot(t).abs() < 1e-6 && (t.length() - 1.0).abs() < 1e-6, "{n} {t}");
    }

    #[test]
    fn attributes_are_full_or_empty() {
        let flat = flatten(&scene(Affine3A::IDENTITY, 1));
        assert_eq!((flat.tangents.len(), flat.second_uvs.len(), flat.colors.len()), (2, 2, 0));
        assert_eq!((flat.tangents[1], flat.second_uvs[1]), ([[0.0; 4]; 3], [[0.0; 2]; 3]));
        // Coordinates that no instance's material uses are dropped.
        assert!(flatten(&scene(Affine3A::IDENTITY, 0)).second_uvs.is_empty());
        let mut unmapped = scene(Affine3A::IDENTITY, 1);
        unmapped.instances.remove(0);
        let flat = flatten(&unmapped);
        assert!(flat.tangents.is_empty() && flat.second_uvs.is_empty());
    }
}
