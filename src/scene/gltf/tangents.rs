//! Tangents for normal maps: the file's, else made from texture coordinates by MikkTSpace, as glTF 2.0 asks.

use std::collections::HashMap;

use bevy_mikktspace::{TangentSpace, generate_tangents};
use glam::{DVec3, Vec2, Vec3, Vec4};

use super::fault::Warnings;
use crate::scene::{Material, Mesh, TextureRef};

/// Triangles at one position. The work of MikkTSpace grows with the square, its recursion with the number.
const MAX_AT_POSITION: u32 = 1024;

/// What making tangents takes at most, with all corners split from one another.
pub const BYTES_PER_TRIANGLE: usize = 1100;

/// The map that a mesh's tangents are for: the base's, which a coat's map shares them with.
pub fn wanted_by(material: &Material) -> Option<TextureRef> {
    material.normal_map.or(material.clearcoat.normal_map).map(|map| map.texture)
}

/// Gives the mesh tangents for `map`: those `given`, else its own. All are zero where its coordinates are absent.
pub fn give(mesh: &mut Mesh, map: TextureRef, given: Option<Vec<Vec4>>, place: &str, warnings: &mut Warnings) {
    if mesh.uvs[map.uv_set].is_empty() {
        warnings.note("normal maps are left out of meshes without texture coordinates for them", place);
        mesh.tangents = vec![Vec4::ZERO; mesh.positions.len()];
        return;
    }
    mesh.tangents = given.unwrap_or_default();
    if mesh.tangents.is_empty() {
        let (tangents, complete) = generate(mesh, map);
        if !complete {
            warnings.note("normal maps are left out where very many triangles meet", place);
        }
        split(mesh, &tangents);
        morph(mesh, map);
    }
}

/// Gives each morph target the tangents of its shape, since a mesh without tangents has those of its moved vertices (glTF
/// 2.0, 3.7.2.2). Directions in which u grows blend as positions do, so offsets are in units of their size at rest.
fn morph(mesh: &mut Mesh, map: TextureRef) {
    let mut morphs = std::mem::take(&mut mesh.morphs);
    let rest = if morphs.is_empty() { Vec::new() } else { along_u(mesh, map) };
    for morph in &mut morphs {
        morph.tangents = Vec::new();
        let moved = |rest: &[Vec3], by: &[Vec3]| -> Vec<Vec3> {
            rest.iter().enumerate().map(|(i, v)| v + by.get(i).copied().unwrap_or_default()).collect()
        };
        let mut positions = moved(&mesh.positions, &morph.positions);
        let mut normals = moved(&mesh.normals, &morph.normals);
        normals.iter_mut().zip(&mesh.normals).for_each(|(n, rest)| *n = n.normalize_or(*rest));
        if positions == mesh.positions && normals == mesh.normals || positions.iter().any(|p| !p.is_finite()) {
            continue;
        }
        std::mem::swap(&mut positions, &mut mesh.positions);
        std::mem::swap(&mut normals, &mut mesh.normals);
        let shape = along_u(mesh, map);
        (mesh.positions, mesh.normals) = (positions, normals);
        let offset = |((shape, rest), tangent): ((&Vec3, &Vec3), &Vec4)| {
            let offset = *shape / rest.length() - tangent.truncate();
            if *shape != Vec3::ZERO && offset.is_finite() { offset } else { Vec3::ZERO }
        };
        morph.tangents = shape.iter().zip(&rest).zip(&mesh.tangents).map(offset).collect();
    }
    mesh.morphs = morphs;
}

/// Returns the derivative of each vertex's position along u, in its tangent's direction; 0 where it has none.
fn along_u(mesh: &Mesh, map: TextureRef) -> Vec<Vec3> {
    let mut along = vec![Vec3::ZERO; mesh.positions.len()];
    for (&vertex, made) in mesh.triangles.as_flattened().iter().zip(generate(mesh, map).0.as_flattened()) {
        if let Some((tangent, size)) = made {
            along[vertex as usize] = *size * tangent.truncate();
        }
    }
    along
}

/// A corner's tangent, and how far a position moves with u there.
type Made = Option<(Vec4, f32)>;

/// Makes a tangent for each corner by MikkTSpace, none where that has nothing to say. Also returns whether every triangle
/// with an area was taken.
fn generate(mesh: &Mesh, map: TextureRef) -> (Vec<[Made; 3]>, bool) {
    let uvs = mesh.uvs[map.uv_set].iter().map(|&uv| map.uv_from_uv.transform_point2(uv)).collect();
    let bits = |v: u32| mesh.positions[v as usize].to_array().map(f32::to_bits);
    let mut crowd: HashMap<[u32; 3], u32> = HashMap::new();
    for &v in mesh.triangles.as_flattened() {
        *crowd.entry(bits(v)).or_default() += 1;
    }
    let position = |v: u32| mesh.positions[v as usize];
    // Triangles without area are never seen, and MikkTSpace searches all others for each of them.
    let has_area = |&[a, b, c]: &[u32; 3]| {
        let [a, b, c] = [position(a), position(b), position(c)];
        a != b && b != c && c != a
    };
    let crowded = |t: &[u32; 3]| t.iter().any(|&v| crowd[&bits(v)] > MAX_AT_POSITION);
    let complete = !mesh.triangles.iter().any(|t| has_area(t) && crowded(t));
    let taken = |i: &usize| has_area(&mesh.triangles[*i]) && !crowded(&mesh.triangles[*i]);
    let faces = (0..mesh.triangles.len()).filter(taken).collect();
    let mut corners = Corners { mesh, uvs, faces, tangents: vec![[None; 3]; mesh.triangles.len()] };
    let complete = generate_tangents(&mut corners).is_ok() && complete;
    (corners.tangents, complete)
}

/// A mesh as MikkTSpace asks for it, corner by corner.
struct Corners<'a> {
    mesh: &'a Mesh,
    /// Where the map is sampled, per vertex.
    uvs: Vec<Vec2>,
    /// The triangles to look at.
    faces: Vec<usize>,
    /// Per triangle of the mesh.
    tangents: Vec<[Made; 3]>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.triangles[self.faces[face]][corner] as usize
    }
}

impl bevy_mikktspace::Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.faces.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        let of_triangle = || {
            let [a, b, c] = self.mesh.triangles[self.faces[face]].map(|v| self.mesh.positions[v as usize].as_dvec3());
            (b - a).cross(c - a).try_normalize().unwrap_or(DVec3::Z).as_vec3()
        };
        self.mesh.normals.get(self.vertex(face, corner)).copied().unwrap_or_else(of_triangle).to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.uvs[self.vertex(face, corner)].to_array()
    }

    /// MikkTSpace's bitangent runs along v, which in glTF is down the image; a normal map's green is up.
    fn set_tangent(&mut self, made: Option<TangentSpace>, face: usize, corner: usize) {
        let encode = |made: TangentSpace| {
            let direction = Vec3::from_array(made.tangent()).try_normalize()?;
            let sign = if made.is_orientation_preserving() { -1.0 } else { 1.0 };
            Some((direction.extend(sign), made.tangent_magnitude()))
        };
        self.tangents[self.faces[face]][corner] = made.and_then(encode);
    }
}

/// Gives each vertex the tangent of its corners; where they disagree, the others get copies of it. Corners without a
/// tangent take their vertex's, which without any is zero.
fn split(mesh: &mut Mesh, corners: &[[Made; 3]]) {
    let mut tangents: Vec<Option<Vec4>> = vec![None; mesh.positions.len()];
    let mut copies: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let Mesh { positions, normals, uvs: [uvs_0, uvs_1], colors, triangles, influences, morphs, .. } = mesh;
    for (vertex, &tangent) in triangles.as_flattened_mut().iter_mut().zip(corners.as_flattened()) {
        let Some((tangent, _)) = tangent else { continue };
        let original = *vertex as usize;
        if *tangents[original].get_or_insert(tangent) == tangent {
            continue;
        }
        *vertex = *copies.entry((*vertex, tangent.to_array().map(f32::to_bits))).or_insert_with(|| {
            tangents.push(Some(tangent));
            duplicate(positions, original);
            duplicate(normals, original);
            duplicate(uvs_0, original);
            duplicate(uvs_1, original);
            duplicate(colors, original);
            duplicate(influences, original);
            for morph in &mut *morphs {
                duplicate(&mut morph.positions, original);
                duplicate(&mut morph.normals, original);
                duplicate(&mut morph.tangents, original);
            }
            tangents.len() as u32 - 1
        });
    }
    mesh.tangents = tangents.into_iter().map(Option::unwrap_or_default).collect();
}

/// Appends element `i`, unless the attribute is absent.
fn duplicate<T: Copy>(attribute: &mut Vec<T>, i: usize) {
    if let Some(&value) = attribute.get(i) {
        attribute.push(value);
    }
}
