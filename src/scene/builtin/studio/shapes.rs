//! Shapes of the studio: boxes, spheres and turned pieces.

use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};
use std::f32::consts::{PI, TAU};

use super::maths::sin_cos;
use super::surface::{Surface, Vertex};

/// Returns a box of `size` with the middle of its bottom at `foot`.
pub fn block(foot: [f32; 3], size: [f32; 3]) -> Surface {
    let half = [size[0] / 2.0, size[2] / 2.0];
    let min = Vec3::new(foot[0] - half[0], foot[1], foot[2] - half[1]);
    let size = Vec3::new(foot[0] + half[0], foot[1] + size[1], foot[2] + half[1]) - min;
    let (x, y, z) = (Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z);
    Surface::union([
        Surface::quad(min + x, -x, y),
        Surface::quad(min + z, x, y),
        Surface::quad(min, z, y),
        Surface::quad(min + x + z, -z, y),
        Surface::quad(min, x, z),
        Surface::quad(min + y + z, x, -z),
    ])
}

/// Returns a sphere about the origin, tessellated into `around` cells of longitude and `up` cells of latitude. Texture
/// coordinates cover the unit square.
pub fn sphere(radius: f32, around: usize, up: usize) -> Surface {
    Surface::grid(up, around, |u, v| {
        // Exact coordinates at the poles and the seam close the surface.
        let (ring, height) = match u {
            u if u <= 0.0 => (0.0, -1.0),
            u if u >= 1.0 => (0.0, 1.0),
            u => (sin_cos(u * PI).0, -sin_cos(u * PI).1),
        };
        let (s, c) = sin_cos(if v < 1.0 { v * TAU } else { 0.0 });
        let normal = Vec3::new(ring * c, height, ring * s);
        Vertex { position: normal * radius, normal, uv: Vec2::new(1.0 - v, 1.0 - u) }
    })
}

/// Returns a cylinder along +y with the centre of its bottom at the origin.
pub fn cylinder(radius: f32, height: f32, sides: usize) -> Surface {
    lathe(&[[0.0, 0.0], [radius, 0.0], [radius, height], [0.0, height]], sides)
}

/// One end of a profile's edge, with its distance along the profile from the first point.
#[derive(Clone, Copy)]
struct End {
    point: Vec2,
    normal: Vec2,
    along: f32,
}

/// Turns a profile of points (radius, height) about the y axis in `sides` steps. The profile runs upwards outside.
/// Shallow corners are smoothed.
pub fn lathe(profile: &[[f32; 2]], sides: usize) -> Surface {
    let frames: Vec<Affine3A> = (0..=sides)
        .map(|i| {
            let (s, c) = sin_cos((i % sides) as f32 / sides as f32 * TAU);
            let x = Vec3A::new(c, 0.0, s);
            Affine3A { matrix3: Mat3A::from_cols(x, Vec3A::Y, x.cross(Vec3A::Y)), translation: Vec3A::ZERO }
        })
        .collect();
    let normals: Vec<Mat3A> = frames.iter().map(|f| f.matrix3.inverse().transpose()).collect();
    let mut s = Surface::default();
    for edge in edges(profile) {
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
        for i in 0..sides as u32 {
            let a = base + 2 * i;
            s.face([a, a + 1, a + 3, a + 2]);
        }
    }
    s
}

/// Returns the edges of a profile, whose outside is on the right of its direction.
fn edges(profile: &[[f32; 2]]) -> Vec<[End; 2]> {
    /// Dot product of adjacent edges' normals above which a corner is smoothed.
    const SMOOTH_ABOVE: f32 = 0.72;
    let count = profile.len() - 1;
    let point = |i: usize| Vec2::from(profile[i]);
    let normal = |i: usize| -(point(i + 1) - point(i)).normalize().perp();
    let blend = |own: usize, other: Option<usize>| match other.map(normal) {
        Some(o) if normal(own).dot(o) > SMOOTH_ABOVE => (normal(own) + o).normalize(),
        _ => normal(own),
    };
    let mut along = 0.0;
    (0..count)
        .map(|i| {
            let from = End { point: point(i), normal: blend(i, i.checked_sub(1)), along };
            along += point(i + 1).distance(point(i));
            [from, End { point: point(i + 1), normal: blend(i, Some(i + 1).filter(|&i| i < count)), along }]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the volume enclosed by a closed surface; negative if it is inside out.
    fn signed_volume(surface: &Surface) -> f32 {
        let corner = |i: u32| surface.vertices[i as usize].position.as_dvec3();
        let six: f64 = surface.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2])))).sum();
        (six / 6.0) as f32
    }

    fn solids() -> Vec<(&'static str, Surface, f32)> {
        vec![
            ("block", block([1.0, 0.0, 0.0], [1.0, 2.0, 3.0]), 6.0),
            ("sphere", sphere(0.5, 96, 48), PI / 6.0),
            ("cylinder", cylinder(0.5, 2.0, 128), PI / 2.0),
            // Cones of volume π/3 · 1, π/3 · 2.71 and π/3 · 0.81.
            ("turned", lathe(&[[0.0, 0.0], [1.0, 1.0], [0.9, 2.0], [0.0, 3.0]], 128), PI * 4.52 / 3.0),
        ]
    }

    #[test]
    fn solids_have_the_volume_of_their_formula() {
        for (name, surface, volume) in solids() {
            let got = signed_volume(&surface);
            assert!((got - volume).abs() < 0.01 * volume, "{name}: {got}, not {volume}");
        }
    }

    #[test]
    fn solids_are_watertight() {
        for (name, surface, _) in solids() {
            let key = |i: u32| surface.vertices[i as usize].position.to_array().map(|c| (c * 1e5).round() as i64);
            let mut open = std::collections::HashMap::new();
            for t in &surface.triangles {
                for k in 0..3 {
                    let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
                    *open.entry(if a < b { (a, b) } else { (b, a) }).or_insert(0) += if a < b { 1 } else { -1 };
                }
            }
            assert!(open.values().all(|&n| n == 0), "{name}");
        }
    }
}
