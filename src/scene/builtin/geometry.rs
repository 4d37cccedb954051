//! Mesh building kit: surfaces of smooth or sharp-edged triangles, made from grids and by sweeping outlines.
//!
//! Surfaces are wound counter-clockwise seen from outside and have unit normals. Texture coordinates are in metres
//! unless said otherwise. Transforms must not mirror.

use super::super::Mesh;
use super::maths::sin_cos;
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};

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

    pub fn append(&mut self, other: &Surface) {
        let base = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }

    pub fn with(mut self, other: Surface) -> Self {
        self.append(&other);
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

    /// Flips the surface to face the other side.
    pub fn flipped(mut self) -> Self {
        self.vertices.iter_mut().for_each(|v| v.normal = -v.normal);
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
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

/// A polyline in the plane whose outside is on the right of its direction: a closed outline runs counter-clockwise, and
/// a profile to be turned about an axis runs upwards.
#[derive(Clone, Debug)]
pub struct Outline {
    points: Vec<Vec2>,
    closed: bool,
    /// Threshold on the dot product of adjacent edges' normals above which a corner is smoothed.
    smooth_above: f32,
}

/// One end of an outline's edge, with its distance along the outline from the first point.
#[derive(Clone, Copy)]
struct End {
    point: Vec2,
    normal: Vec2,
    along: f32,
}

impl Outline {
    pub fn open(points: impl IntoIterator<Item = [f32; 2]>) -> Self {
        let points = points.into_iter().map(Vec2::from).collect();
        Self { points, closed: false, smooth_above: 0.72 }
    }

    pub fn closed(points: impl IntoIterator<Item = [f32; 2]>) -> Self {
        Self { closed: true, ..Self::open(points) }
    }

    /// Returns a counter-clockwise rectangle.
    pub fn rectangle(min: [f32; 2], max: [f32; 2]) -> Self {
        Self::closed([[min[0], min[1]], [max[0], min[1]], [max[0], max[1]], [min[0], max[1]]])
    }

    pub fn circle(centre: [f32; 2], radius: f32, sides: usize) -> Self {
        Self::closed((0..sides).map(|i| {
            let (s, c) = sin_cos(i as f32 / sides as f32 * std::f32::consts::TAU);
            [centre[0] + radius * c, centre[1] + radius * s]
        }))
        .smooth()
    }

    /// Smooths every corner.
    pub fn smooth(self) -> Self {
        Self { smooth_above: -1.0, ..self }
    }

    pub fn edge_count(&self) -> usize {
        self.points.len() - usize::from(!self.closed)
    }

    fn edges(&self) -> Vec<[End; 2]> {
        let n = self.points.len();
        let count = self.edge_count();
        let direction = |i: usize| (self.points[(i + 1) % n] - self.points[i % n]).normalize();
        let normal = |i: usize| -direction(i).perp();
        let blend = |own: usize, other: Option<usize>| match other.map(normal) {
            Some(o) if normal(own).dot(o) > self.smooth_above => (normal(own) + o).normalize(),
            _ => normal(own),
        };
        let mut along = 0.0;
        (0..count)
            .map(|i| {
                let before = if i > 0 { Some(i - 1) } else { self.closed.then_some(count - 1) };
                let after = if i + 1 < count { Some(i + 1) } else { self.closed.then_some(0) };
                let from = End { point: self.points[i], normal: blend(i, before), along };
                let point = self.points[(i + 1) % n];
                along += point.distance(from.point);
                [from, End { point, normal: blend(i, after), along }]
            })
            .collect()
    }

    /// Returns the surface that the outline traces as its plane moves through `frames`. Each frame maps the plane
    /// (x, y, 0) into space, with z pointing along the path. The ends of the surface are open.
    pub fn sweep(&self, frames: &[Affine3A]) -> Surface {
        let mut s = Surface::default();
        let normals: Vec<Mat3A> = frames.iter().map(|f| f.matrix3.inverse().transpose()).collect();
        for edge in self.edges() {
            let base = s.vertices.len() as u32;
            let mut travelled = [0.0; 2];
            for (i, frame) in frames.iter().enumerate() {
                for (side, end) in edge.iter().enumerate() {
                    let position = frame.transform_point3(end.point.extend(0.0));
                    if i > 0 {
                        travelled[side] += position.distance(s.vertices[s.vertices.len() - 2].position);
                    }
                    s.vertices.push(Vertex {
                        position,
                        normal: (normals[i] * Vec3A::from(end.normal.extend(0.0))).normalize().into(),
                        uv: Vec2::new(travelled[side], end.along),
                    });
                }
            }
            for i in 0..frames.len() as u32 - 1 {
                let a = base + 2 * i;
                s.face([a, a + 1, a + 3, a + 2]);
            }
        }
        s
    }

    /// Returns the flat surface that fills a closed outline, which must be star-shaped about the mean of its points.
    /// The front faces the frame's z axis if `towards_z`, else the opposite direction.
    pub fn cap(&self, frame: Affine3A, towards_z: bool) -> Surface {
        let middle = self.points.iter().sum::<Vec2>() / self.points.len() as f32;
        let vertex = |p: Vec2| Vertex {
            position: frame.transform_point3(p.extend(0.0)),
            normal: frame.transform_vector3(Vec3::Z).normalize(),
            uv: p,
        };
        let n = self.points.len() as u32;
        let mut s = Surface {
            vertices: self.points.iter().map(|&p| vertex(p)).chain([vertex(middle)]).collect(),
            triangles: (0..n).map(|i| [i, (i + 1) % n, n]).collect(),
        };
        if !towards_z {
            s = s.flipped();
        }
        s
    }

    /// Sweeps a closed outline like [`sweep`](Self::sweep) and closes both ends with caps, which gives a solid.
    pub fn sweep_solid(&self, frames: &[Affine3A]) -> Surface {
        let (first, last) = (frames[0], frames[frames.len() - 1]);
        self.sweep(frames).with(self.cap(first, false)).with(self.cap(last, true))
    }
}
