//! Triangles of instances in world space, or of a mesh in its local space. Rows of the tables are made one by one in the
//! order of the tree, on all cores, so that they are in memory only once.

use glam::{Affine3A, DVec3, Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::triangle::{Shading, TRIANGLE_ALPHA, Triangle, unit_normal};
use crate::scene::{AlphaMode, Instance, Material, Mesh, Scene};

/// A list of triangles.
#[derive(Default)]
pub(super) struct Flat<'a> {
    meshes: Vec<Placed<'a>>,
    /// Index into `meshes` and index of the mesh's triangle.
    triangles: Vec<[u32; 2]>,
}

/// A mesh under a transform.
struct Placed<'a> {
    mesh: &'a Mesh,
    place: Affine3A,
    linear: Mat3,
    /// The cofactor matrix: the inverse transpose up to a factor, defined for flattened (singular) transforms too.
    cofactor: Mat3,
    mirrored: bool,
    /// True if the normals are negated at last.
    negated: bool,
    first_copy: u32,
}

/// Optional vertex attributes that the scene has. The list of an attribute has an entry for every triangle or none at
/// all.
#[derive(Clone, Copy)]
pub(super) struct Present {
    pub colors: bool,
    pub second_uvs: bool,
    pub tangents: bool,
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
pub(super) fn flatten<'a>(scene: &'a Scene, instances: impl Iterator<Item = &'a Instance>, origin: DVec3) -> Flat<'a> {
    let mut flat = Flat::default();
    for instance in instances {
        let mesh = &scene.meshes[instance.mesh];
        let place = near_from_local(instance, origin);
        let mirrored = place.matrix3.determinant() < 0.0;
        flat.push(Placed::new(mesh, place, mirrored, &scene.materials[mesh.material]), false);
    }
    flat
}

/// Flattens the shape of a deforming body to world space. Keeps degenerate triangles, since they may have an area in
/// other frames.
pub(super) fn deforming<'a>(scene: &Scene, shape: &'a Mesh, origin: DVec3) -> Flat<'a> {
    let mut flat = Flat::default();
    let place = Affine3A::from_translation(-origin.as_vec3());
    flat.push(Placed::new(shape, place, false, &scene.materials[shape.material]), true);
    flat
}

/// Flattens a mesh in its local space, for instances that are all mirrored or all not. Triangles are counter-clockwise
/// in world space, and the inverse transpose maps normals to world space.
pub(super) fn local(scene: &Scene, mesh: usize, mirrored: bool) -> Flat<'_> {
    let mut flat = Flat::default();
    let mesh = &scene.meshes[mesh];
    let placed = Placed::new(mesh, Affine3A::IDENTITY, mirrored, &scene.materials[mesh.material]);
    // The normals are those of the mesh, not of a mirrored transform.
    flat.push(Placed { negated: mirrored, ..placed }, false);
    flat
}

impl<'a> Flat<'a> {
    fn push(&mut self, placed: Placed<'a>, keeps_all: bool) {
        let number = self.meshes.len() as u32;
        let count = placed.mesh.triangles.len();
        self.triangles.reserve_exact(count);
        // Triangles without area are left out.
        let is_kept = |index: &usize| keeps_all || placed.normal(*index).is_some();
        self.triangles.par_extend((0..count).into_par_iter().filter(is_kept).map(|index| [number, index as u32]));
        self.meshes.push(placed);
    }

    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    fn at(&self, index: usize) -> (&Placed<'a>, usize) {
        let [mesh, triangle] = self.triangles[index];
        (&self.meshes[mesh as usize], triangle as usize)
    }

    /// Returns the vertices of a triangle.
    pub fn vertices(&self, index: usize) -> [Vec3; 3] {
        let (placed, triangle) = self.at(index);
        placed.vertices(triangle)
    }

    /// Returns a triangle with `first_copy` as the row of its first copy.
    pub fn triangle(&self, index: usize, first_copy: u32) -> Triangle {
        let (placed, triangle) = self.at(index);
        let [v0, v1, v2] = placed.vertices(triangle);
        let material = placed.mesh.material as u32;
        Triangle { v0, material, v1, first_copy: placed.first_copy | first_copy, v2, light: 0 }
    }

    pub fn shading(&self, index: usize) -> Shading {
        let (placed, triangle) = self.at(index);
        placed.shading(triangle)
    }

    /// Returns the colours of a triangle's corners: white if the mesh has none.
    pub fn colors(&self, index: usize) -> [[f32; 4]; 3] {
        let (placed, triangle) = self.at(index);
        placed.corners(triangle).map(|i| placed.mesh.colors.get(i).map_or([1.0; 4], |c| c.to_array()))
    }

    /// Returns the texture coordinates of set 1 of a triangle's corners.
    pub fn second_uvs(&self, index: usize) -> [[f32; 2]; 3] {
        let (placed, triangle) = self.at(index);
        placed.uvs(triangle, 1).map(|uv| uv.to_array())
    }

    /// Returns the tangents of a triangle's corners: 0 if the mesh has none.
    pub fn tangents(&self, index: usize) -> [[f32; 4]; 3] {
        let (placed, triangle) = self.at(index);
        placed.tangents(triangle)
    }
}

impl<'a> Placed<'a> {
    fn new(mesh: &'a Mesh, place: Affine3A, mirrored: bool, material: &Material) -> Self {
        let linear = Mat3::from(place.matrix3);
        let cofactor = Mat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        ) * if mirrored { -1.0 } else { 1.0 };
        let first_copy = if material.alpha_mode == AlphaMode::Opaque { 0 } else { TRIANGLE_ALPHA };
        Self { mesh, place, linear, cofactor, mirrored, negated: false, first_copy }
    }

    /// Returns the vertex indices of a triangle. Mirroring reverses its winding.
    fn corners(&self, triangle: usize) -> [usize; 3] {
        let [a, b, c] = self.mesh.triangles[triangle];
        if self.mirrored { [a, c, b] } else { [a, b, c] }.map(|i| i as usize)
    }

    fn vertices(&self, triangle: usize) -> [Vec3; 3] {
        self.corners(triangle).map(|i| self.place.transform_point3(self.mesh.positions[i]))
    }

    /// Returns the unit normal of a triangle, or `None` if the triangle has no area.
    fn normal(&self, triangle: usize) -> Option<Vec3> {
        unit_normal(self.vertices(triangle))
    }

    fn uvs(&self, triangle: usize, set: usize) -> [Vec2; 3] {
        self.corners(triangle).map(|i| self.mesh.uvs[set].get(i).copied().unwrap_or(Vec2::ZERO))
    }

    fn shading(&self, triangle: usize) -> Shading {
        let normal = self.normal(triangle).unwrap_or(Vec3::Z);
        let [n0, n1, n2] = self.corners(triangle).map(|i| {
            let of_vertex = self.mesh.normals.get(i).map(|&n| (self.cofactor * n).try_normalize().unwrap_or(normal));
            let n = of_vertex.unwrap_or(normal);
            if self.negated { -n } else { n }
        });
        let [t0, t1, t2] = self.uvs(triangle, 0);
        Shading { n0, u0: t0.x, n1, v0: t0.y, n2, u1: t1.x, v1: t1.y, u2: t2.x, v2: t2.y, pad: 0.0 }
    }

    fn tangents(&self, triangle: usize) -> [[f32; 4]; 3] {
        // A mirrored frame is left-handed, so the bitangent's sign flips.
        let handedness = if self.mirrored { -1.0 } else { 1.0 };
        self.corners(triangle).map(|i| match self.mesh.tangents.get(i) {
            Some(t) => {
                let tangent = (self.linear * t.truncate()).normalize_or_zero();
                tangent.extend(t.w * handedness).to_array()
            }
            None => [0.0; 4],
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::{Affine2, Affine3A, Quat, Vec4};

    use super::*;
    use crate::accel::Accel;
    use crate::scene::{NormalMap, TextureRef};

    fn flatten(scene: &Scene) -> Flat<'_> {
        super::flatten(scene, scene.instances.iter(), DVec3::ZERO)
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
        let still = scene(Affine3A::IDENTITY, 1);
        let still = flatten(&still);
        for scale in [Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0), Vec3::new(2.0, 2.0, -2.0), Vec3::splat(-3.0)] {
            let turn = Quat::from_rotation_y(0.7) * Quat::from_rotation_z(-0.4);
            let world = Affine3A::from_scale_rotation_translation(scale, turn, Vec3::ONE);
            let moved = scene(world, 1);
            let flat = flatten(&moved);
            let corners = if scale.element_product() < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
            let normals = |f: &Flat<'_>| [f.shading(0).n0, f.shading(0).n1, f.shading(0).n2];
            for (now, before) in corners.into_iter().enumerate() {
                let (n, t) = (normals(&flat)[now], flat.tangents(0)[now]);
                let (n0, t0) = (normals(&still)[before], still.tangents(0)[before]);
                let moved = |v: Vec3| world.transform_vector3(v).normalize();
                assert!(Vec4::from_array(t).truncate().distance(moved(Vec4::from_array(t0).truncate())) < 1e-6);
                assert!(n.distance(moved(n0)) < 1e-6);
                assert!(bitangent(n, t).distance(moved(bitangent(n0, t0))) < 1e-6, "{scale} {now}");
                assert_eq!(flat.second_uvs(0)[now], still.second_uvs(0)[before]);
            }
        }
    }

    #[test]
    fn tangents_stay_perpendicular_under_uneven_scale() {
        let stretched = scene(Affine3A::from_scale(Vec3::new(5.0, 1.0, 0.5)), 1);
        let flat = flatten(&stretched);
        let (n, t) = (flat.shading(0).n2, Vec4::from_array(flat.tangents(0)[2]).truncate());
        assert!(n.dot(t).abs() < 1e-6 && (t.length() - 1.0).abs() < 1e-6, "{n} {t}");
    }

    #[test]
    fn attributes_are_full_or_empty() {
        let tables = |scene: &Scene| Accel::build(scene).unwrap();
        let lengths = |accel: &Accel| [accel.tangents.len(), accel.second_uvs.len(), accel.colors.len()];
        let accel = tables(&scene(Affine3A::IDENTITY, 1));
        let corners = 3 * accel.triangles.len();
        assert_eq!(lengths(&accel), [corners, corners, 0]);
        let bare = 3 * accel.triangles.iter().position(|t| t.material == 1).unwrap();
        assert_eq!(accel.tangents[bare..bare + 3], [[0.0; 4]; 3]);
        assert_eq!(accel.second_uvs[bare..bare + 3], [[0.0; 2]; 3]);
        // Coordinates that no instance's material uses are dropped.
        assert_eq!(lengths(&tables(&scene(Affine3A::IDENTITY, 0)))[1], 0);
        let mut unmapped = scene(Affine3A::IDENTITY, 1);
        unmapped.instances.remove(0);
        assert_eq!(lengths(&tables(&unmapped)), [0; 3]);
    }
}
