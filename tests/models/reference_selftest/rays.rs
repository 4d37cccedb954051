//! Rays and sampled directions.

use glam::{DVec3, Vec3, vec3};

use crate::reference::intersect::{self, Geometry, Ray, Triangle};
use crate::reference::sampling::{Rng, cone_direction, cosine_direction};
use crate::reference::scenes::icosphere;

/// Rays from inside a closed mesh towards its vertices and edges: none escapes, even far from the origin and at small
/// scale.
#[test]
fn no_ray_leaks_through_shared_edges() {
    for (size, offset) in [(1.0f64, 0.0f64), (1e-3, 1e2), (1e6, 0.0)] {
        let mesh = icosphere(2, false, 0);
        let at = |p: Vec3| p.as_dvec3() * size + DVec3::new(offset, -offset, offset * 0.5);
        let triangles: Vec<Triangle> = mesh
            .triangles
            .iter()
            .enumerate()
            .map(|(index, t)| Triangle { vertices: t.map(|i| at(mesh.positions[i as usize])), instance: 0, index })
            .collect();
        let geometry = Geometry::new(triangles.clone());
        let origin = at(vec3(0.1, -0.2, 0.05));
        let mut rng = Rng::new(1, 2);
        for _ in 0..20 {
            for triangle in &triangles {
                let [a, b, _] = triangle.vertices;
                let target = match rng.uniform() {
                    x if x < 0.2 => a,
                    x => a.lerp(b, x),
                };
                let ray = Ray { origin, direction: (target - origin).normalize() };
                let hit = geometry.closest(&ray, f64::INFINITY, None, |_, _| true);
                let distance = (target - origin).length();
                let t = hit.expect("a ray leaked").t;
                assert!((t / distance - 1.0).abs() < 1e-9, "{t} {distance}");
                assert_eq!(geometry.transmittance(&ray, distance * 2.0, [None; 2], |_, _| DVec3::ZERO), DVec3::ZERO);
                assert_eq!(geometry.transmittance(&ray, distance * 0.99, [None; 2], |_, _| DVec3::ZERO), DVec3::ONE);
            }
        }
    }
}

/// A ray that starts just off a wall still hits it, as in a corner.
#[test]
fn walls_nearer_than_the_hierarchy_can_tell_are_hit() {
    let corners = [DVec3::ZERO, DVec3::Y * 10.0, DVec3::Z * 10.0];
    let wall = |x: f64, index: usize| Triangle { vertices: corners.map(|c| c + DVec3::X * x), instance: 0, index };
    // A dense pile up to x = 5 in a scene ten wide, so that its inner nodes have a fine grid.
    let mut places: Vec<f64> = (0..400).map(|i| 5.0 - 1e-3 * f64::from(i)).collect();
    places.extend([0.0, 10.0]);
    let walls = places.iter().enumerate().map(|(i, &x)| wall(x, i));
    let geometry = Geometry::new(walls.collect());
    for distance in [5e-4, 1e-4, 1e-5, 1e-6, 1e-8] {
        let origin = DVec3::new(5.0 - distance, 1.0, 1.0);
        let direction = DVec3::new(1.0, 0.3, 0.2).normalize();
        let expected = distance / direction.x;
        let hit = geometry.closest(&Ray { origin, direction }, f64::INFINITY, None, |_, _| true);
        let t = hit.expect("a hit").t;
        assert!((t - expected).abs() < 1e-12, "{t} {expected}");
    }
}

/// Compares the hierarchy with a loop over all triangles.
#[test]
fn hierarchy_equals_brute_force() {
    let mut rng = Rng::new(3, 4);
    let mut vector = || DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0;
    let triangles: Vec<Triangle> = (0..400)
        .map(|index| {
            let centre = vector() * 5.0;
            let vertices = [centre + vector(), centre + vector(), centre + vector()];
            Triangle { vertices, instance: 0, index }
        })
        .collect();
    let geometry = Geometry::new(triangles.clone());
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    for i in 0..4_000 {
        let direction = if i % 4 == 0 { axes[i / 4 % 6] } else { vector().normalize() };
        // Rays start inside, or far outside.
        let origin = vector() * 4.0 - direction * if i % 3 == 0 { 1e4 } else { 0.0 };
        let ray = Ray { origin, direction };
        let found = geometry.closest(&ray, f64::INFINITY, None, |_, _| true).map(|h| h.t);
        let expected = triangles
            .iter()
            .filter_map(|t| intersect::intersect_triangle(&ray, &t.vertices))
            .map(|(t, _)| t)
            .filter(|&t| t > 1e-9)
            .min_by(f64::total_cmp);
        assert_eq!(found, expected);
    }
}

/// Checks means of cos θ: 2/3 for the cosine lobe, (1 + cos θ₀) / 2 for a cone.
#[test]
fn directions_have_their_densities() {
    let mut rng = Rng::new(5, 6);
    for axis in [DVec3::Y, DVec3::new(0.6, 0.0, -0.8), DVec3::new(-1.0, 2.0, 2.0) / 3.0] {
        let n = 100_000;
        let (mut lobe, mut cone, mut sum) = (0.0, 0.0, DVec3::ZERO);
        for _ in 0..n {
            lobe += cosine_direction(axis, rng.uniforms()).dot(axis) / f64::from(n);
            let direction = cone_direction(axis, 0.4, &mut rng);
            cone += direction.dot(axis) / f64::from(n);
            sum += direction / f64::from(n);
        }
        assert!((lobe - 2.0 / 3.0).abs() < 0.004, "{lobe}");
        assert!((cone - 0.8).abs() < 0.002, "{cone}");
        assert!((sum - axis * 0.8).length() < 0.01, "{sum}");
    }
}
