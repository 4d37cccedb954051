//! Search for a viewpoint if a file has no camera: in front of an object, or inside a room.
//!
//! Ray casts tell a room from an object by the number of distinct triangles whose front they hit: in a room, it is
//! larger from inside than from outside.

use std::collections::HashSet;

use glam::{DVec3, Mat3, Vec3, Vec3A, vec3a};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;

use super::budget::Budget;
use super::rig::{DEFAULT_BASELINE_M, Rig, RigKey};
use super::{Instance, Scene};

/// Default vertical fields of view in degrees: inside a room, and of an object seen from outside, which would look
/// distorted in a wider field of view.
const INSIDE_YFOV_DEG: f64 = 70.0;
const OUTSIDE_YFOV_DEG: f64 = 40.0;

/// Ratio of the image's size to the object's size in it, if the object is seen from outside.
const MARGIN: f32 = 1.06;

/// Limit on triangles after instancing: the search flattens all instances and builds a BVH only for itself.
const MOST_TRIANGLES: usize = 1 << 20;

/// Memory that the search reserves per triangle, bytes.
const TRIANGLE_BYTES: usize = 640;

/// Heights in metres: of the eyes above a floor, of rooms in which people stand, and of the lowest usable room.
const EYE_HEIGHT_M: f32 = 1.6;
const ROOM_HEIGHTS_M: std::ops::Range<f32> = 2.0..12.0;
const LEAST_HEIGHT_M: f32 = 1.0;

/// Viewpoint found for a scene without a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    pub rig: Rig,
    pub is_inside: bool,
}

/// Finds a viewpoint, for this vertical field of view if one is given. Returns that of [`Rig::framing`] for scenes
/// without triangles, with too many, or over the budget.
pub fn find(scene: &Scene, metres_per_unit: f64, yfov_rad: Option<f64>, budget: &Budget) -> Viewpoint {
    let yfov_rad = |default_deg: f64| yfov_rad.unwrap_or(default_deg.to_radians());
    let count = scene.triangle_count();
    let reserved = (count <= MOST_TRIANGLES).then(|| budget.reserve((count * TRIANGLE_BYTES) as u64).ok()).flatten();
    let (is_inside, rig) = match reserved.as_ref().and_then(|_| Surfaces::of(scene, metres_per_unit)) {
        None => (false, Rig::framing(scene.bounds(), yfov_rad(OUTSIDE_YFOV_DEG))),
        Some(surfaces) => {
            let around = surfaces.best_side();
            match surfaces.best_stand().filter(|stand| stand.seen > around.seen) {
                Some(stand) => (true, surfaces.rig_within(&stand, yfov_rad(INSIDE_YFOV_DEG))),
                None => (false, surfaces.rig_before(around.from, yfov_rad(OUTSIDE_YFOV_DEG))),
            }
        }
    };
    // Limits the baseline, so that a viewer can fuse even scenes that are smaller than a head.
    let distance_m = (rig.keys[0].position - rig.keys[0].target).length() * metres_per_unit;
    let widest_m = distance_m / if is_inside { 15.0 } else { 30.0 };
    let rig = Rig { baseline_m: DEFAULT_BASELINE_M.min(widest_m), metres_per_unit, ..rig };
    Viewpoint { rig, is_inside }
}

/// The scene's triangles, scaled to [-1, 1]³, and a BVH of them.
struct Surfaces {
    triangles: Vec<Triangle>,
    tree: CwBvh,
    centre: DVec3,
    /// World units per unit of this space.
    radius: f64,
    metres_per_unit: f64,
    /// True if the scene has lights or emitters, so that even a closed interior is lit.
    is_lit: bool,
    min: Vec3A,
    max: Vec3A,
}

/// The best view from outside, and the number of distinct triangles whose front faces are hit by rays from any of the
/// tested outside views.
struct Side {
    /// Unit vector from the object to the eyes.
    from: Vec3A,
    seen: usize,
}

/// A view from inside, and the number of distinct triangles whose front faces are hit by rays from its position.
#[derive(Clone, Copy)]
struct Stand {
    eye: Vec3A,
    ahead: Vec3A,
    seen: usize,
}

/// First hit of a ray.
struct Met {
    t: f32,
    triangle: u32,
    is_front: bool,
}

impl Surfaces {
    fn of(scene: &Scene, metres_per_world_unit: f64) -> Option<Self> {
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
        let is_lit = !scene.lights.is_empty() || scene.instances.iter().any(emits);
        Some(Self { triangles, tree, centre, radius, metres_per_unit, is_lit, min: -half, max: half })
    }

    fn meet(&self, origin: Vec3A, direction: Vec3A) -> Option<Met> {
        let mut hit = RayHit::none();
        let at = |slot: usize| self.tree.primitive_indices[slot] as usize;
        let ray = Ray::new_inf(origin, direction);
        self.tree.ray_traverse(ray, &mut hit, |ray, slot| self.triangles[at(slot)].intersect(ray));
        hit.t.is_finite().then(|| {
            let triangle = at(hit.primitive_id as usize);
            let Triangle { v0, v1, v2 } = self.triangles[triangle];
            let is_front = (v1 - v0).cross(v2 - v0).dot(direction) < 0.0;
            Met { t: hit.t, triangle: triangle as u32, is_front }
        })
    }

    /// Returns the view from outside in which the number of rays that hit front faces, minus that of rays that hit back
    /// faces, is largest. Prefers the view from above and right of +z, unless another one is much better.
    fn best_side(&self) -> Side {
        const RAYS: usize = 18;
        let mut seen = HashSet::new();
        let mut best: Option<(f32, Vec3A)> = None;
        for (yaw_deg, pitch_deg) in
            [(30.0f32, 18.0f32), (-30.0, 18.0), (150.0, 18.0), (-150.0, 18.0), (0.0, 80.0), (0.0, -60.0)]
        {
            let from = direction(yaw_deg, pitch_deg);
            let ([right, up, _], reach) = (axes(-from), 3.0f32.sqrt());
            let mut share = 0.0;
            for i in 0..RAYS * RAYS {
                let at = |i: usize| 2.0 * (i as f32 + 0.5) / RAYS as f32 - 1.0;
                let origin = (right * at(i % RAYS) + up * at(i / RAYS)) * reach + from * 2.0 * reach;
                if let Some(met) = self.meet(origin, -from) {
                    share += if met.is_front { 1.0 } else { -1.0 };
                    seen.extend(met.is_front.then_some(met.triangle));
                }
            }
            if best.is_none_or(|(most, _)| share > 1.5 * most.max(0.0)) {
                best = Some((share, from));
            }
        }
        Side { from: best.map_or(Vec3A::Z, |(_, from)| from), seen: seen.len() }
    }

    /// Returns the best view from a position that is above a floor and surrounded by surfaces.
    fn best_stand(&self) -> Option<Stand> {
        const COLUMNS: usize = 9;
        /// Number of most promising positions that are examined more closely.
        const LOOKED_FROM: usize = 16;
        let share = |i: usize| (i as f32 + 0.5) / COLUMNS as f32;
        let at = |i: usize| self.min + (self.max - self.min) * vec3a(share(i % COLUMNS), 0.0, share(i / COLUMNS));
        let eyes = (0..COLUMNS * COLUMNS).flat_map(|i| self.eyes_above_floors(at(i).x, at(i).z));
        let mut stands: Vec<_> = eyes.filter_map(|eye| Some((self.seen_around(eye, 128)?, eye))).collect();
        stands.sort_by_key(|(seen, _)| std::cmp::Reverse(*seen));
        stands.truncate(LOOKED_FROM);
        let stands = stands.into_iter().filter_map(|(_, eye)| Some((self.seen_around(eye, 1024)?, eye)));
        let views = stands.flat_map(|(seen, eye)| {
            let turns = (0..16).map(|i| direction(22.5 * i as f32, -5.0));
            turns.map(move |ahead| Stand { eye, ahead, seen })
        });
        views.map(|stand| (self.worth(&stand), stand)).max_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, stand)| stand)
    }

    /// Returns the number of distinct triangles whose front faces are hit by `rays` rays from `eye`. Returns `None`
    /// unless front faces surround `eye`, and light sources or openings to the outside can light its surroundings.
    fn seen_around(&self, eye: Vec3A, rays: usize) -> Option<usize> {
        let met: Vec<Met> = sphere(rays).filter_map(|d| self.meet(eye, d)).collect();
        let fronts: Vec<u32> = met.iter().filter(|m| m.is_front).map(|m| m.triangle).collect();
        let is_within = 10 * met.len() >= 7 * rays && 10 * fronts.len() >= 9 * met.len();
        let is_bright = self.is_lit || 50 * (rays - met.len()) >= rays;
        (is_within && is_bright).then(|| fronts.into_iter().collect::<HashSet<_>>().len())
    }

    /// Returns positions at eye height above the floors that the vertical line at (`x`, `z`) hits.
    fn eyes_above_floors(&self, x: f32, z: f32) -> Vec<Vec3A> {
        const MOST_FLOORS: usize = 8;
        let mut eyes = Vec::new();
        let mut top = vec3a(x, self.max.y + 0.1, z);
        for _ in 0..MOST_FLOORS {
            let Some(met) = self.meet(top, Vec3A::NEG_Y) else { break };
            let floor = top - Vec3A::Y * met.t;
            let ceiling = self.meet(floor + Vec3A::Y * 1e-3, Vec3A::Y).map_or(self.max.y, |m| floor.y + 1e-3 + m.t);
            let free = ceiling - floor.y;
            let metres_per_unit = self.metres_per_unit as f32;
            let free_m = free * metres_per_unit;
            let is_room = ROOM_HEIGHTS_M.contains(&free_m);
            let height = if is_room { EYE_HEIGHT_M / metres_per_unit } else { 0.55 * free };
            if met.is_front && free > 0.05 && free_m >= LEAST_HEIGHT_M {
                eyes.push(floor + Vec3A::Y * height);
            }
            top = floor - Vec3A::Y * 1e-3;
        }
        eyes
    }

    /// Returns a view's score. Deep views of many triangles, with none too near, score best.
    fn worth(&self, stand: &Stand) -> f32 {
        const RAYS: [usize; 2] = [20, 12];
        let [right, up, ahead] = axes(stand.ahead);
        let tan = (INSIDE_YFOV_DEG as f32 / 2.0).to_radians().tan();
        let (mut seen, mut depth) = (HashSet::new(), 0.0);
        for i in 0..RAYS[0] * RAYS[1] {
            let at = |i: usize, n: usize| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
            let [x, y] = [at(i % RAYS[0], RAYS[0]) * 16.0 / 9.0, at(i / RAYS[0], RAYS[1])];
            let Some(met) = self.meet(stand.eye, (ahead + (right * x + up * y) * tan).normalize()) else { continue };
            depth += if met.is_front && met.t > 0.05 { met.t.min(1.0) } else { -1.0 };
            seen.extend(met.is_front.then_some(met.triangle));
        }
        depth.max(0.0) * (seen.len() as f32).sqrt()
    }

    fn rig_within(&self, stand: &Stand, yfov_rad: f64) -> Rig {
        self.rig(stand.eye, stand.eye + stand.ahead * 0.5, yfov_rad)
    }

    /// Returns a rig that fits the whole object into a square image.
    fn rig_before(&self, from: Vec3A, yfov_rad: f64) -> Rig {
        let [right, up, _] = axes(-from);
        let tan = (yfov_rad / 2.0).tan() as f32 / MARGIN;
        // An eye at x = c sees a point if |x − c| ≤ (distance − depth) tan. The two extremes of depth ± x / tan over
        // all points give the smallest distance and the x at which it is reached.
        let mut most = [f32::NEG_INFINITY; 4];
        for p in self.triangles.iter().flat_map(|t| [t.v0, t.v1, t.v2]) {
            let (depth, x, y) = (p.dot(from), p.dot(right) / tan, p.dot(up) / tan);
            for (most, v) in most.iter_mut().zip([depth + x, depth - x, depth + y, depth - y]) {
                *most = most.max(v);
            }
        }
        let [x_right, x_left, y_up, y_down] = most;
        let distance = ((x_right + x_left) / 2.0).max((y_up + y_down) / 2.0);
        let target = right * (x_right - x_left) / 2.0 * tan + up * (y_up - y_down) / 2.0 * tan;
        self.rig(target + from * distance, target, yfov_rad)
    }

    fn rig(&self, eye: Vec3A, target: Vec3A, yfov_rad: f64) -> Rig {
        let most = DVec3::splat(f64::from(f32::MAX));
        let world = |p: Vec3A| (self.centre + Vec3::from(p).as_dvec3() * self.radius).clamp(-most, most);
        let key = RigKey { time_s: 0.0, position: world(eye), target: world(target), up: DVec3::Y };
        Rig { yfov_rad, ..Rig::of_keys(vec![key]) }
    }
}

/// Returns right, up and ahead of a viewer who looks along `ahead`, which is not vertical.
fn axes(ahead: Vec3A) -> [Vec3A; 3] {
    let right = ahead.cross(Vec3A::Y).normalize();
    [right, right.cross(ahead), ahead]
}

/// Returns +z, rotated by `yaw_deg` towards +x and by `pitch_deg` upwards.
fn direction(yaw_deg: f32, pitch_deg: f32) -> Vec3A {
    let turned = Mat3::from_rotation_y(yaw_deg.to_radians()) * Mat3::from_rotation_x(-pitch_deg.to_radians());
    Vec3A::from(turned * Vec3::Z)
}

/// Returns directions spread evenly over the sphere (Fibonacci lattice).
fn sphere(count: usize) -> impl Iterator<Item = Vec3A> {
    const GOLDEN_ANGLE: f32 = 2.399_963_2;
    (0..count).map(move |i| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
        let (sin, cos) = (GOLDEN_ANGLE * i as f32).sin_cos();
        let r = (1.0 - y * y).sqrt();
        vec3a(r * cos, y, r * sin)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::rig::Eye;
    use crate::scene::{Light, LightKind, Material, Mesh};
    use glam::{Affine3A, vec3};

    /// Returns a closed box. Its front faces point inwards if `is_seen_within`, else outwards.
    fn block(centre: Vec3, half: Vec3, is_seen_within: bool) -> Mesh {
        let corner =
            |i: u32| centre + half * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - half;
        let quads = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let halves = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let triangles = halves.map(|[a, b, c]| if is_seen_within { [a, c, b] } else { [a, b, c] }).collect();
        Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() }
    }

    fn scene(meshes: Vec<Mesh>, place: Affine3A) -> Scene {
        let instances = (0..meshes.len()).map(|mesh| Instance { mesh, world_from_local: place }).collect();
        Scene { meshes, instances, materials: vec![Material::default()], ..Scene::empty("test") }
    }

    fn found(scene: &Scene) -> Viewpoint {
        find(scene, 1.0, None, &Budget::unlimited())
    }

    /// Returns a point's position in the left eye's image: -1 to 1 over its height.
    fn seen_at(rig: &Rig, point: Vec3) -> [f32; 2] {
        let view = rig.view(0.0, Eye::Left);
        let d = point - view.origin;
        let depth = d.dot(view.forward);
        assert!(depth > 0.0, "{point} is behind");
        [view.right, view.up].map(|axis| d.dot(axis) / depth / view.tan_half_yfov)
    }

    #[test]
    fn an_object_fills_the_picture_whatever_its_scale_and_place() {
        for (scale, offset) in [(1.0, Vec3::ZERO), (1e-3, Vec3::ONE), (1e5, vec3(0.0, 1e6, 0.0))] {
            let place = Affine3A::from_scale_rotation_translation(Vec3::splat(scale), glam::Quat::IDENTITY, offset);
            let mesh = block(vec3(1.0, 2.0, 3.0), vec3(0.2, 1.0, 0.3), false);
            let corners: Vec<Vec3> = mesh.positions.iter().map(|p| place.transform_point3(*p)).collect();
            let found = found(&scene(vec![mesh], place));
            assert!(!found.is_inside);
            let seen: Vec<[f32; 2]> = corners.iter().map(|p| seen_at(&found.rig, *p)).collect();
            let most = seen.as_flattened().iter().fold(0.0f32, |a, b| a.max(b.abs()));
            assert!((0.85..1.0).contains(&most), "x {scale}: {seen:?}");
        }
    }

    #[test]
    fn a_room_is_seen_from_within() {
        let half = vec3(3.0, 1.3, 4.0);
        let things = [vec3(-1.5, -1.0, -2.0), vec3(1.0, -0.9, 1.0), vec3(2.0, -1.1, -3.0)];
        let mut meshes = vec![block(Vec3::ZERO, half, true), block(Vec3::ZERO, half + 0.2, false)];
        meshes.extend(things.map(|at| block(at, Vec3::splat(0.3), false)));
        let mut room = scene(meshes, Affine3A::IDENTITY);
        assert!(!found(&room).is_inside, "it is dark in there");
        let lamp = LightKind::Point { position: Vec3::ZERO, radius: 0.0 };
        room.lights.push(Light { kind: lamp, strength: Vec3::ONE });
        let found = found(&room);
        assert!(found.is_inside);
        let eye = found.rig.keys[0].position.as_vec3();
        assert!(eye.abs().cmplt(half).all(), "{eye}");
        assert!(things.iter().all(|at| (eye - at).abs().max_element() > 0.3), "{eye} is in a thing");
    }

    /// Many exporters write double-sided materials, even for objects that should not be viewed from inside.
    #[test]
    fn a_double_sided_shell_is_seen_from_without() {
        let mut shell = scene(vec![block(Vec3::ZERO, vec3(3.0, 1.3, 4.0), false)], Affine3A::IDENTITY);
        shell.materials[0] = Material { double_sided: true, emissive: Vec3::ONE, ..Material::default() };
        assert!(!found(&shell).is_inside);
    }

    #[test]
    fn nothing_a_point_or_a_line_are_seen_from_somewhere() {
        let line = Mesh { positions: vec![Vec3::ZERO, Vec3::X], triangles: vec![[0, 1, 0]], ..Mesh::default() };
        let point = Mesh { positions: vec![Vec3::ONE], triangles: vec![[0, 0, 0]], ..Mesh::default() };
        for meshes in [vec![], vec![line], vec![point]] {
            let view = found(&scene(meshes, Affine3A::IDENTITY)).rig.view(0.0, Eye::Left);
            assert!(view.origin.is_finite() && view.forward.is_finite() && view.right.is_finite());
        }
    }
}
