//! Distance from a point to the nearest surface.

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;

use super::triangle::power_scale;
use super::{Accel, Instance, Triangle};

impl Accel {
    /// Returns a lower bound on the distance from `point`, relative to [`Self::origin`], to the nearest triangle, or
    /// infinity in an empty scene. The bound is loose for non-uniformly scaled instances. Dynamic geometry is in its
    /// pose at time 0.
    pub fn clearance(&self, point: Vec3) -> f32 {
        let mut nearest = f32::INFINITY;
        self.visit(0, point, &mut nearest, |row, p, nearest| {
            *nearest = distance(&self.triangles[row], p).min(*nearest)
        });
        if self.instances.len() > 1 {
            self.visit(self.instance_tree, point, &mut nearest, |row, p, nearest| self.visit_instance(row, p, nearest));
        }
        nearest
    }

    fn visit_instance(&self, row: usize, point: Vec3, nearest: &mut f32) {
        let Instance { local_from_world: rows, root, .. } = self.instances[row];
        let local = Vec3::from(rows.map(|r| r.dot(point.extend(1.0))));
        // The Frobenius norm bounds how much any direction is stretched.
        let scale = rows.iter().map(|r| r.truncate().length_squared()).sum::<f32>().sqrt();
        let mut nearest_local = *nearest * scale;
        self.visit(root, local, &mut nearest_local, |row, p, n| *n = distance(&self.triangles[row], p).min(*n));
        *nearest = (nearest_local / scale).min(*nearest);
    }

    /// Traverses the tree under the node `root`. Calls `leaf` with the table row of each triangle or instance in a leaf
    /// whose bounds are nearer to `point` than `nearest`. `leaf` may lower `nearest`.
    fn visit(&self, root: u32, point: Vec3, nearest: &mut f32, leaf: impl Fn(usize, Vec3, &mut f32)) {
        let mut open = vec![(root, 0.0)];
        while let Some((index, node_distance)) = open.pop() {
            if node_distance >= *nearest {
                continue;
            }
            let node: CwBvhNode = bytemuck::cast(self.nodes[index as usize]);
            let mut inner = Vec::new();
            for child in (0..8).filter(|&c| !node.is_child_empty(c)) {
                let child_distance = box_distance(&node.child_aabb(child), point);
                if child_distance >= *nearest {
                    continue;
                }
                if node.is_leaf(child) {
                    let (first, count) = node.child_primitives(child);
                    (first..first + count).for_each(|row| leaf(row as usize, point, nearest));
                } else {
                    inner.push((node.child_node_index(child), child_distance));
                }
            }
            // Visits the nearest child first.
            inner.sort_by(|a, b| b.1.total_cmp(&a.1));
            open.extend(inner);
        }
    }
}

fn box_distance(bounds: &Aabb, point: Vec3) -> f32 {
    let (min, max) = (Vec3::from(bounds.min), Vec3::from(bounds.max));
    point.distance(point.clamp(min, max))
}

/// Returns the distance to a triangle by the feature whose Voronoi region holds the point (Ericson, "Real-Time
/// Collision Detection", 2005, 5.1.5).
fn distance(t: &Triangle, p: Vec3) -> f32 {
    // Relative to the first corner and scaled, since products of four lengths overflow and underflow.
    let scale = power_scale((t.v1 - t.v0).abs().max((t.v2 - t.v0).abs()).max((p - t.v0).abs()));
    let (ab, ac, ap) = ((t.v1 - t.v0) * scale, (t.v2 - t.v0) * scale, (p - t.v0) * scale);
    let (bp, cp) = (ap - ab, ap - ac);
    let [d1, d2, d3, d4, d5, d6] = [ab.dot(ap), ac.dot(ap), ab.dot(bp), ac.dot(bp), ab.dot(cp), ac.dot(cp)];
    let [va, vb, vc] = [d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2];
    let along = |from: Vec3, edge: Vec3| {
        let s = (ap - from).dot(edge) / edge.length_squared();
        ap.distance(from + edge * s.clamp(0.0, 1.0))
    };
    let inside = va + vb + vc;
    if va > 0.0 && vb > 0.0 && vc > 0.0 && inside.is_normal() {
        return ap.distance(ab * (vb / inside) + ac * (vc / inside)) / scale;
    }
    along(Vec3::ZERO, ab).min(along(Vec3::ZERO, ac)).min(along(ab, ac - ab)) / scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Layout;
    use crate::scene::builtin;

    /// Returns the smallest distance to points spread over a triangle.
    fn sampled(t: &Triangle, p: Vec3) -> f32 {
        let steps = 64;
        let points = (0..=steps).flat_map(|i| (0..=steps - i).map(move |j| (i, j)));
        let at = |(i, j): (i32, i32)| t.v0 + (t.v1 - t.v0) * (i as f32 / 64.0) + (t.v2 - t.v0) * (j as f32 / 64.0);
        points.map(|ij| p.distance(at(ij))).fold(f32::INFINITY, f32::min)
    }

    #[test]
    fn distance_to_a_triangle_is_to_its_nearest_point() {
        let t = Triangle { v0: Vec3::ZERO, v1: Vec3::X * 2.0, v2: Vec3::new(0.5, 1.5, 0.5), ..Default::default() };
        for i in 0..1000 {
            let unit = |k: f32| (i as f32 * k).fract() * 6.0 - 3.0;
            let p = Vec3::new(unit(0.618), unit(0.414), unit(0.732));
            let (exact, about) = (distance(&t, p), sampled(&t, p));
            assert!(exact <= about + 1e-6 && exact >= about - 0.03, "{p}: {exact} against {about}");
        }
    }

    #[test]
    fn triangles_of_any_size_have_a_distance() {
        for size in [1e-12, 1.0, 1e14] {
            let t = Triangle { v0: Vec3::ZERO, v1: Vec3::X * size, v2: Vec3::Y * size, ..Default::default() };
            let found = distance(&t, Vec3::new(0.25, 0.25, 0.5) * size);
            assert!((found / size - 0.5).abs() < 1e-6, "{size:e}: {found:e}");
        }
    }

    #[test]
    fn clearance_finds_the_nearest_triangle() {
        for (layout, name) in [(Layout::Flat, "atrium"), (Layout::Flat, "cornell"), (Layout::TwoLevel, "forest")] {
            let scene = builtin::find(name).unwrap().build();
            let flat = Accel::build_with(&scene, Layout::Flat).unwrap();
            let accel = Accel::build_with(&scene, layout).unwrap();
            let bounds = scene.bounds();
            for i in 0..20 {
                let s = Vec3::new(0.618, 0.414, 0.732) * i as f32;
                let p = bounds.min + (bounds.max - bounds.min) * s.fract() - accel.origin.as_vec3();
                let exact = flat.triangles.iter().map(|t| distance(t, p)).fold(f32::INFINITY, f32::min);
                let found = accel.clearance(p);
                assert!(found <= exact * 1.0001 + 1e-5, "{name} {p}: {found} against {exact}");
                assert!(
                    found >= exact * if layout == Layout::Flat { 0.9999 } else { 0.3 } - 1e-5,
                    "{name} {p}: {found}"
                );
            }
        }
    }
}
