//! Triangles and their attributes as rows of the tables.

use glam::Vec3;

use crate::wgsl::shared_structs;

/// Flag in [`Triangle::first_copy`]: the material's alpha decides whether the triangle stops a ray.
pub const TRIANGLE_ALPHA: u32 = 1 << 31;

shared_structs! {
    /// A triangle as rays intersect it: exact vertices, counter-clockwise from the front. Both triangles at an edge
    /// store the same bits for its vertices.
    pub struct Triangle {
        pub v0: Vec3,
        pub material: u32,
        pub v1: Vec3,
        /// Row of the triangle's first copy, combined with the flag [`TRIANGLE_ALPHA`]. Hits identify the triangle by
        /// this row. A large triangle that was split among several leaves has a copy in each.
        pub first_copy: u32,
        pub v2: Vec3,
        /// Number of its light, if any; set once lights are known.
        pub light: u32,
    }

    /// Attributes interpolated over a triangle: normals and texture coordinates, with u and v packed between the
    /// normals.
    pub struct Shading {
        pub n0: Vec3,
        pub u0: f32,
        pub n1: Vec3,
        pub v0: f32,
        pub n2: Vec3,
        pub u1: f32,
        pub v1: f32,
        pub u2: f32,
        pub v2: f32,
        pub pad: f32,
    }
}

/// Returns the power of two that scales a vector's largest component to 1 … 2. Scaling by it is exact, and squares of
/// scaled vectors neither overflow nor underflow.
pub(super) fn power_scale(v: Vec3) -> f32 {
    f32::from_bits((254 - (v.abs().max_element().to_bits() >> 23).clamp(1, 253)) << 23)
}

/// Returns the unit normal of a triangle, or `None` if the triangle has no area.
pub(super) fn unit_normal([v0, v1, v2]: [Vec3; 3]) -> Option<Vec3> {
    let (e1, e2) = (v1 - v0, v2 - v0);
    let scale = power_scale(e1.abs().max(e2.abs()));
    let cross = (e1 * scale).cross(e2 * scale);
    (cross * power_scale(cross)).try_normalize()
}

impl Triangle {
    pub fn area(&self) -> f32 {
        let cross = (self.v1 - self.v0).cross(self.v2 - self.v0);
        let scale = power_scale(cross);
        0.5 * ((cross * scale).length() / scale)
    }

    pub fn asks_alpha(&self) -> bool {
        self.first_copy & TRIANGLE_ALPHA != 0
    }

    /// Returns true if `row` is the row of the triangle's first copy.
    pub fn is_first(&self, row: usize) -> bool {
        (self.first_copy & !TRIANGLE_ALPHA) as usize == row
    }
}
