//! Ray casts against the scene's triangles.

use glam::{DVec3, Mat3, Vec3, Vec3A, vec3a};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;

use crate::scene::rig::{Rig, RigKey};
use crate::scene::{Instance, Scene};

/// The scene's triangles, scaled to [-1, 1]³, and a BVH of them.
pub struct Surfaces {
    pub triangles: Vec<Triangle>,
    tree: CwBvh,
    centre: DVec3,
    /// World units per unit of this space.
    pub radius: f64,
    pub metres_per_unit: f64,
    /// True if even a closed interior is lit: the scene has lights or emitters, or gets light.
    pub is_lit: bool,
    pub min: Vec3A,
    pub max: Vec3A,
}

/// First hit of a ray.
pub struct Met {
    pub t: f32,
    pub triangle: u32,
    pub is_front: bool,
    /// Unit normal of the side that the ray hits.
    pub normal: Vec3A,
}

impl Surfaces {
    pub fn of(scene: &Scene, metres_per_world_unit: f64, gets_light: bool) -> Option<Self> {
        let bounds = scene.bounds();
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let (centre, radius) = ((min + max) / 2.0, (max - min).max_element() / 2.0);
        if !(radius.is_finite() && radius > 0.0) {
            return None;
        }
        let mut triangles = Vec::new();
        for instance in &scene.instances {
            let mesh = &scene.meshes[instance.mesh];
            let world = |i: u32| {
                let p = instance.world_from_local.transform_point3(mesh.positions[i as usize]);
                ((p.as_dvec3() - centre) / radius).as_vec3a()
            };
            let is_mirrored = instance.world_from_local.matrix3.determinant() < 0.0;
            for corners in &mesh.triangles {
                let [v0, mut v1, mut v2] = corners.map(world);
                if is_mirrored {
                    std::mem::swap(&mut v1, &mut v2);
                }
                if (v1 - v0).cross(v2 - v0).length_squared() > 0.0 {
                    triangles.push(Triangle { v0, v1, v2 });
                }
            }
        }
        if triangles.is_empty() {
            return None;
        }
        let tree = build_cwbvh_from_tris(&triangles, BvhBuildParams::fast_build(), &mut Default::default());
        let half = ((max - min) / 2.0 / radius).as_vec3a();
        let metres_per_unit = radius * metres_per_world_unit;
        let emits =
            |instance: &Instance| scene.materials[scene.meshes[instance.mesh].material].emissive.max_element() > 0.0;
        let is_lit = gets_light || !scene.lights.is_empty() || scene.instances.iter().any(emits);
        Some(Self { triangles, tree, centre, radius, metres_per_unit, is_lit, min: -half, max: half })
    }

    pub fn meet(&self, origin: Vec3A, direction: Vec3A) -> Option<Met> {
        let mut hit = RayHit::none();
        let at = |slot: usize| self.tree.primitive_indices[slot] as usize;
        let ray = Ray::new_inf(origin, direction);
        self.tree.ray_traverse(ray, &mut hit, |ray, slot| self.triangles[at(slot)].intersect(ray));
        hit.t.is_finite().then(|| {
            let triangle = at(hit.primitive_id as usize);
            let Triangle { v0, v1, v2 } = self.triangles[triangle];
            let normal = (v1 - v0).cross(v2 - v0).normalize_or_zero();
            let is_front = normal.dot(direction) < 0.0;
            Met { t: hit.t, triangle: triangle as u32, is_front, normal: if is_front { normal } else { -normal } }
        })
    }

    /// Returns a point of the world in this space.
    pub fn local(&self, position: DVec3) -> Vec3A {
        ((position - self.centre) / self.radius).as_vec3a()
    }

    pub fn rig(&self, eye: Vec3A, target: Vec3A, yfov_rad: f64) -> Rig {
        let most = DVec3::splat(f64::from(f32::MAX));
        let world = |p: Vec3A| (self.centre + Vec3::from(p).as_dvec3() * self.radius).clamp(-most, most);
        let key = RigKey { time_s: 0.0, position: world(eye), target: world(target), up: DVec3::Y };
        Rig { yfov_rad, ..Rig::of_keys(vec![key]) }
    }
}

/// Returns right, up and ahead of a viewer who looks along `ahead`, which is not vertical.
pub fn axes(ahead: Vec3A) -> [Vec3A; 3] {
    let right = ahead.cross(Vec3A::Y).normalize();
    [right, right.cross(ahead), ahead]
}

/// Returns +z, rotated by `yaw_deg` towards +x and by `pitch_deg` upwards.
pub fn direction(yaw_deg: f32, pitch_deg: f32) -> Vec3A {
    let turned = Mat3::from_rotation_y(yaw_deg.to_radians()) * Mat3::from_rotation_x(-pitch_deg.to_radians());
    Vec3A::from(turned * Vec3::Z)
}

/// Returns directions spread evenly over the sphere (Fibonacci lattice).
pub fn sphere(count: usize) -> impl Iterator<Item = Vec3A> {
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    (0..count).map(move |i| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
        let (sin, cos) = (GOLDEN_ANGLE * i as f32).sin_cos();
        let r = (1.0 - y * y).sqrt();
        vec3a(r * cos, y, r * sin)
    })
}
