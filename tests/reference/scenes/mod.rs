//! Small procedural scenes that together use the whole model, each with its camera; and helpers to build them.

pub mod lit;
pub mod lobes;
pub mod materials;
pub mod matte;
pub mod moving;
pub mod pictures;
pub mod studio;

use diptych::scene::{Instance, Material, Mesh, Scene, TexelImage, Texture, TextureRef, Wrap};
use glam::{Affine2, Affine3A, Quat, Vec3, vec3};

use super::Pinhole;
pub use pictures::{checker, sky};

pub fn empty(name: &str) -> Scene {
    Scene::empty(name)
}

pub fn matte() -> Material {
    Material::default()
}

pub fn colored(albedo: Vec3) -> Material {
    Material { base_color: albedo.extend(1.0), ..matte() }
}

pub fn add_material(scene: &mut Scene, material: Material) -> usize {
    scene.materials.push(material);
    scene.materials.len() - 1
}

pub fn add_matte(scene: &mut Scene, albedo: Vec3) -> usize {
    add_material(scene, colored(albedo))
}

pub fn add_image(scene: &mut Scene, image: TexelImage) -> usize {
    scene.images.push(image.into());
    scene.images.len() - 1
}

/// Adds a repeating texture on the first coordinate set.
pub fn add_texture(scene: &mut Scene, image: TexelImage, linear: bool) -> TextureRef {
    let image = add_image(scene, image);
    scene.textures.push(Texture { image, wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, linear });
    TextureRef { texture: scene.textures.len() - 1, uv_set: 0, uv_from_uv: Affine2::IDENTITY }
}

pub fn add_mesh(scene: &mut Scene, mesh: Mesh) -> usize {
    scene.meshes.push(mesh);
    scene.meshes.len() - 1
}

pub fn instance(scene: &mut Scene, mesh: usize, world_from_local: Affine3A) {
    scene.instances.push(Instance { mesh, world_from_local });
}

/// Adds the mesh with one instance.
pub fn place_at(scene: &mut Scene, mesh: Mesh, world_from_local: Affine3A) {
    let mesh = add_mesh(scene, mesh);
    instance(scene, mesh, world_from_local);
}

/// Adds a parallelogram; see [`quad`].
pub fn add_quad(scene: &mut Scene, (corner, u, v): (Vec3, Vec3, Vec3), material: Material) {
    let material = add_material(scene, material);
    place(scene, quad(corner, u, v, material));
}

/// Adds the mesh with one instance at the origin.
pub fn place(scene: &mut Scene, mesh: Mesh) {
    place_at(scene, mesh, Affine3A::IDENTITY);
}

pub fn scaled_at(scale: f32, at: Vec3) -> Affine3A {
    Affine3A::from_scale_rotation_translation(Vec3::splat(scale), Quat::IDENTITY, at)
}

/// Returns a parallelogram whose front faces along `u` × `v`, with corners in the order 0, u, u + v, v.
pub fn quad(corner: Vec3, u: Vec3, v: Vec3, material: usize) -> Mesh {
    Mesh {
        positions: vec![corner, corner + u, corner + u + v, corner + v],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        ..Mesh::default()
    }
}

/// Returns a cube of edge 1 around the origin that faces outwards.
pub fn block(material: usize) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    for (n, u) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for n in [n, -n] {
            let v = n.cross(u);
            let face = quad((n - u - v) * 0.5, u, v, material);
            append(&mut mesh, face);
        }
    }
    mesh
}

pub fn append(mesh: &mut Mesh, part: Mesh) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(part.positions);
    mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
}

/// Returns the triangles of a grid of vertices in row-major order, columns to the right and rows up.
fn grid(columns: u32, rows: u32) -> Vec<[u32; 3]> {
    let at = |row: u32, column: u32| row * (columns + 1) + column;
    let quads = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
    let split = |(row, column): (u32, u32)| {
        let [a, b, c, d] = [at(row, column), at(row, column + 1), at(row + 1, column + 1), at(row + 1, column)];
        [[a, b, c], [a, c, d]]
    };
    quads.flat_map(split).collect()
}

/// Returns a sphere of 20 · 4^`levels` triangles that faces outwards; its corners lie on the unit sphere.
pub fn icosphere(levels: u32, smooth: bool, material: usize) -> Mesh {
    let golden = 0.5 * (1.0 + 5f32.sqrt());
    // The corners of an icosahedron are those of three golden rectangles.
    let rectangle =
        |a: fn(f32, f32) -> Vec3| [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(s, l)| a(s, l * golden));
    let corners: Vec<Vec3> =
        [rectangle(|s, l| vec3(s, l, 0.0)), rectangle(|s, l| vec3(0.0, s, l)), rectangle(|s, l| vec3(l, 0.0, s))]
            .concat()
            .iter()
            .map(|p| p.normalize())
            .collect();
    // Faces join three corners that are nearest to each other.
    let edge = corners.iter().map(|c| c.distance(corners[0])).filter(|d| *d > 0.1).fold(9.0, f32::min);
    let near = |a: Vec3, b: Vec3| a.distance(b) < 1.1 * edge;
    let mut faces = Vec::new();
    for (i, &a) in corners.iter().enumerate() {
        for (j, &b) in corners.iter().enumerate().skip(i + 1) {
            for &c in &corners[j + 1..] {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outward = (b - a).cross(c - a).dot(a) > 0.0;
                    faces.push(if outward { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..levels {
        let split = |[a, b, c]: [Vec3; 3]| {
            let (ab, bc, ca) = ((a + b).normalize(), (b + c).normalize(), (c + a).normalize());
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        };
        faces = faces.into_iter().flat_map(split).collect();
    }
    let positions = faces.concat();
    Mesh {
        normals: if smooth { positions.clone() } else { Vec::new() },
        triangles: (0..faces.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        positions,
        material,
        ..Mesh::default()
    }
}
