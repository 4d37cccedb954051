//! Surfaces of smooth or sharp-edged triangles, made from grids.
//!
//! They are wound counter-clockwise seen from outside and have unit normals. Texture coordinates are in metres
//! unless said otherwise. Transforms must not mirror.

use glam::{Affine3A, Vec2, Vec3, Vec3A};

use crate::scene::Mesh;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    pub position: Vec3,
    pub normal: Vec3,
    pub uv: Vec2,
}

/// A triangle mesh under construction.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    pub vertices: Vec<Vertex>,
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Tessellates `f` over the unit square (u, v) with `columns` × `rows` cells. The front faces ∂f/∂u × ∂f/∂v.
    pub fn grid(columns: usize, rows: usize, f: impl Fn(f32, f32) -> Vertex) -> Self {
        let mut s = Self::default();
        for j in 0..=rows {
            for i in 0..=columns {
                s.vertices.push(f(i as f32 / columns as f32, j as f32 / rows as f32));
            }
        }
        let at = |i: usize, j: usize| (j * (columns + 1) + i) as u32;
        for j in 0..rows {
            for i in 0..columns {
                s.face([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        s
    }

    /// Builds a [`grid`](Self::grid) of the positions `f(u, v)`. Normals follow from finite differences of `f`, which
    /// must be defined slightly beyond the unit square. Texture coordinates are (u, v).
    pub fn smooth_grid(columns: usize, rows: usize, f: impl Fn(f32, f32) -> Vec3) -> Self {
        const STEP: f32 = 1e-3;
        Self::grid(columns, rows, |u, v| {
            let du = f(u + STEP, v) - f(u - STEP, v);
            let dv = f(u, v + STEP) - f(u, v - STEP);
            Vertex { position: f(u, v), normal: du.cross(dv).normalize(), uv: Vec2::new(u, v) }
        })
    }

    /// Returns a flat parallelogram. The front faces `side_u` × `side_v`.
    pub fn quad(corner: Vec3, side_u: Vec3, side_v: Vec3) -> Self {
        let normal = side_u.cross(side_v).normalize();
        let size = Vec2::new(side_u.length(), side_v.length());
        Self::grid(1, 1, |u, v| Vertex {
            position: corner + side_u * u + side_v * v,
            normal,
            uv: size * Vec2::new(u, v),
        })
    }

    /// Adds a quadrilateral between four vertices. A side of zero length leaves one triangle.
    pub fn face(&mut self, [a, b, c, d]: [u32; 4]) {
        for triangle in [[a, b, c], [a, c, d]] {
            let [p, q, r] = triangle.map(|i| self.vertices[i as usize].position);
            if p != q && q != r && r != p {
                self.triangles.push(triangle);
            }
        }
    }

    pub fn with(mut self, other: Surface) -> Self {
        let base = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
        self
    }

    pub fn union(parts: impl IntoIterator<Item = Surface>) -> Self {
        parts.into_iter().fold(Self::default(), Self::with)
    }

    pub fn transformed(mut self, t: Affine3A) -> Self {
        let normals = t.matrix3.inverse().transpose();
        for v in &mut self.vertices {
            v.position = t.transform_point3(v.position);
            v.normal = (normals * Vec3A::from(v.normal)).normalize().into();
        }
        self
    }

    pub fn moved(self, x: f32, y: f32, z: f32) -> Self {
        self.transformed(Affine3A::from_translation(Vec3::new(x, y, z)))
    }

    pub fn uv_scaled(mut self, factor: Vec2) -> Self {
        self.vertices.iter_mut().for_each(|v| v.uv *= factor);
        self
    }

    pub fn into_mesh(self, material: usize) -> Mesh {
        Mesh {
            positions: self.vertices.iter().map(|v| v.position).collect(),
            normals: self.vertices.iter().map(|v| v.normal).collect(),
            uvs: [self.vertices.iter().map(|v| v.uv).collect(), Vec::new()],
            triangles: self.triangles,
            material,
            ..Mesh::default()
        }
    }
}
