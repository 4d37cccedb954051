//! Intersects rays with triangles and spheres, in f64.
//!
//! obvhs's CWBVH only proposes candidates; every one is tested here, in f64, with the watertight test of Woop, Benthin
//! & Wald (2013). The hierarchy works in f32 and is kept within its limits:
//! - It is built over boxes in a space of its own, [-1, 1]³ around the scene, each box padded by [`PAD`].
//! - Its rays start at most at the sphere around that space, and [`BACK`] before their true start, because
//!   `CwBvhNode::intersect_ray` skips boxes that end nearer than 1e-4.
//! - Its directions have no negative zero, whose reciprocal would have the wrong sign there.

use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray as BvhRay, RayHit};

/// Hierarchy units.
const PAD: f32 = 1e-5;
const BACK: f64 = 0.01;
/// Minimum distance of a hit in scene radii. Nearer hits are on the surface where the ray started.
const T_MIN: f64 = 1e-10;

#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub origin: DVec3,
    /// Unit length.
    pub direction: DVec3,
}

/// A world-space triangle with its origin in the scene.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    pub vertices: [DVec3; 3],
    /// Index into `Scene::instances`.
    pub instance: usize,
    /// Index into `Mesh::triangles`.
    pub index: usize,
}

#[derive(Clone, Copy, Debug)]
pub struct TriangleHit {
    pub t: f64,
    /// Index into [`Geometry::triangles`].
    pub triangle: usize,
    pub weights: [f64; 3],
}

pub struct Geometry {
    pub triangles: Vec<Triangle>,
    bvh: Option<CwBvh>,
    centre: DVec3,
    /// World units per hierarchy unit.
    radius: f64,
}

impl Geometry {
    pub fn new(triangles: Vec<Triangle>) -> Self {
        let mut min = DVec3::INFINITY;
        let mut max = DVec3::NEG_INFINITY;
        for v in triangles.iter().flat_map(|t| t.vertices) {
            min = min.min(v);
            max = max.max(v);
        }
        if triangles.is_empty() {
            return Self { triangles, bvh: None, centre: DVec3::ZERO, radius: 1.0 };
        }
        let centre = (min + max) * 0.5;
        let half = (max - min).max_element() * 0.5;
        let radius = if half > 0.0 { half } else { 1.0 };
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|t| {
                let corners = t.vertices.map(|v| Vec3A::from(((v - centre) / radius).as_vec3()));
                let bounds = Aabb::from_points(&corners);
                Aabb::new(bounds.min - PAD, bounds.max + PAD)
            })
            .collect();
        let bvh = build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        Self { triangles, bvh: Some(bvh), centre, radius }
    }

    /// Returns the nearest hit before `t_max` that is on none of `without` and that `is_there` accepts.
    pub fn closest(
        &self,
        ray: &Ray,
        t_max: f64,
        without: Option<usize>,
        is_there: impl Fn(usize, [f64; 3]) -> bool,
    ) -> Option<TriangleHit> {
        let (bvh, walk) = self.walk(ray, t_max)?;
        let mut nearest: Option<TriangleHit> = None;
        bvh.ray_traverse(walk.ray, &mut RayHit::none(), |_, slot| {
            let triangle = bvh.primitive_indices[slot] as usize;
            let limit = nearest.map_or(t_max, |hit| hit.t);
            match self.hit(ray, triangle, limit, [without, None]) {
                Some(hit) if is_there(triangle, hit.weights) => {
                    nearest = Some(hit);
                    walk.bvh_t(hit.t)
                }
                _ => f32::INFINITY,
            }
        });
        nearest
    }

    /// Returns the product of `passed` over all triangles before `t_max` except those in `without`.
    pub fn transmittance(
        &self,
        ray: &Ray,
        t_max: f64,
        without: [Option<usize>; 2],
        passed: impl Fn(usize, [f64; 3]) -> DVec3,
    ) -> DVec3 {
        let Some((bvh, walk)) = self.walk(ray, t_max) else {
            return DVec3::ONE;
        };
        let mut transmittance = DVec3::ONE;
        bvh.ray_traverse_miss(walk.ray, |_, slot| {
            let triangle = bvh.primitive_indices[slot] as usize;
            if let Some(hit) = self.hit(ray, triangle, t_max, without) {
                transmittance *= passed(triangle, hit.weights);
            }
            // A distance below the ray's end stops the traversal: the ray is already blocked.
            if transmittance == DVec3::ZERO { 0.0 } else { f32::INFINITY }
        });
        transmittance
    }

    fn walk(&self, ray: &Ray, t_max: f64) -> Option<(&CwBvh, Walk)> {
        let bvh = self.bvh.as_ref()?;
        // The scene lies in a sphere of √3 hierarchy units.
        let reach = 2.0 * self.radius;
        let start = match sphere_distances(ray, self.centre, reach) {
            Some([_, leave]) if leave < 0.0 => return None,
            Some([enter, _]) => enter.max(0.0),
            None => return None,
        };
        if t_max <= start {
            return None;
        }
        let walk_start = start - BACK * self.radius;
        let origin = (ray.origin + ray.direction * walk_start - self.centre) / self.radius;
        let direction = ray.direction.as_vec3() + 0.0;
        let mut walk = Walk {
            ray: BvhRay::new_inf(origin.as_vec3().into(), direction.into()),
            start: walk_start,
            radius: self.radius,
        };
        walk.ray.tmax = walk.bvh_t(t_max);
        Some((bvh, walk))
    }

    fn hit(&self, ray: &Ray, triangle: usize, t_max: f64, without: [Option<usize>; 2]) -> Option<TriangleHit> {
        if without.contains(&Some(triangle)) {
            return None;
        }
        let (t, weights) = intersect_triangle(ray, &self.triangles[triangle].vertices)?;
        let inside = t > T_MIN * self.radius && t < t_max;
        inside.then_some(TriangleHit { t, triangle, weights })
    }
}

/// A ray in the hierarchy's space.
struct Walk {
    ray: BvhRay,
    /// Start of the traversal, as a distance along the world ray.
    start: f64,
    radius: f64,
}

impl Walk {
    /// Returns a distance along the hierarchy's ray, rounded away from the start.
    fn bvh_t(&self, t: f64) -> f32 {
        (((t - self.start) / self.radius) * (1.0 + 1e-5) + 1e-5) as f32
    }
}

/// Returns distance (of any sign) and barycentric weights at the intersection of the ray's line with the triangle.
/// Edges belong to both their triangles: each edge function is exactly antisymmetric in its two vertices, so no line
/// passes between triangles that share an edge.
pub fn intersect_triangle(ray: &Ray, vertices: &[DVec3; 3]) -> Option<(f64, [f64; 3])> {
    let d = ray.direction;
    let kz = match d.abs() {
        a if a.x >= a.y && a.x >= a.z => 0,
        a if a.y >= a.z => 1,
        _ => 2,
    };
    let (kx, ky) = ((kz + 1) % 3, (kz + 2) % 3);
    let [a, b, c] = vertices.map(|v| {
        let p = v - ray.origin;
        let along = p[kz] / d[kz];
        DVec3::new(p[kx] - d[kx] * along, p[ky] - d[ky] * along, along)
    });
    let u = c.x * b.y - c.y * b.x;
    let v = a.x * c.y - a.y * c.x;
    let w = b.x * a.y - b.y * a.x;
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let det = u + v + w;
    if det == 0.0 {
        return None;
    }
    let weights = [u / det, v / det, w / det];
    Some((weights[0] * a.z + weights[1] * b.z + weights[2] * c.z, weights))
}

/// Returns the distances (of any sign, in order) at which the ray's line enters and leaves a sphere.
pub fn sphere_distances(ray: &Ray, centre: DVec3, radius: f64) -> Option<[f64; 2]> {
    let to_centre = centre - ray.origin;
    let middle = to_centre.dot(ray.direction);
    // Start from the perpendicular, which keeps precision for small and far spheres.
    let miss = to_centre - ray.direction * middle;
    let half_squared = radius * radius - miss.length_squared();
    (half_squared >= 0.0).then(|| {
        let half = half_squared.sqrt();
        [middle - half, middle + half]
    })
}
