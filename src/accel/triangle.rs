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

impl Triangle {
    pub fn area(&self) -> f32 {
        0.5 * (self.v1 - self.v0).cross(self.v2 - self.v0).length()
    }

    pub fn asks_alpha(&self) -> bool {
        self.first_copy & TRIANGLE_ALPHA != 0
    }

    /// Returns true if `row` is the row of the triangle's first copy.
    pub fn is_first(&self, row: usize) -> bool {
        (self.first_copy & !TRIANGLE_ALPHA) as usize == row
    }
}
