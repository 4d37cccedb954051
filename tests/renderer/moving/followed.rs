//! Motion vectors agree with the surface positions in the previous frame, as computed on the host.

use crate::common::{Stage, Subject};
use crate::reference::scenes::moving;
use diptych::image::Extent;
use diptych::passes::Aov;
use diptych::scene::rig::{Eye, RigKey, View};
use diptych::scene::{LightKind, Scene};
use glam::{DVec2, DVec3, Vec3};

use super::watched;

const EXTENT: Extent = Extent::new(96, 64);

/// Returns the corners of a scene's triangles in world space.
fn triangles(scene: &Scene) -> Vec<[DVec3; 3]> {
    let of_instance = |instance: &diptych::scene::Instance| {
        let mesh = &scene.meshes[instance.mesh];
        let (linear, shift) =
            (glam::Mat3::from(instance.world_from_local.matrix3).as_dmat3(), instance.world_from_local);
        let world = move |p: Vec3| linear * p.as_dvec3() + Vec3::from(shift.translation).as_dvec3();
        mesh.triangles.iter().map(move |t| t.map(|i| world(mesh.positions[i as usize]))).collect::<Vec<_>>()
    };
    scene.instances.iter().flat_map(of_instance).collect()
}

/// Returns the nearest triangle that a ray hits, with the weights of its corners.
fn meets(triangles: &[[DVec3; 3]], origin: DVec3, direction: DVec3) -> Option<(usize, [f64; 3])> {
    let mut nearest = f64::INFINITY;
    let mut found = None;
    for (i, [a, b, c]) in triangles.iter().enumerate() {
        let (e1, e2) = (*b - *a, *c - *a);
        let p = direction.cross(e2);
        let det = e1.dot(p);
        let (s, q) = (origin - *a, (origin - *a).cross(e1));
        let (u, v, t) = (s.dot(p) / det, direction.dot(q) / det, e2.dot(q) / det);
        if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t < nearest {
            (nearest, found) = (t, Some((i, [1.0 - u - v, u, v])));
        }
    }
    found
}

fn pixel(view: &View, p: DVec3) -> DVec2 {
    let v = p - view.origin.as_dvec3();
    let tan = f64::from(view.tan_half_yfov);
    let size = DVec2::new(EXTENT.width.into(), EXTENT.height.into());
    let z = v.dot(view.forward.as_dvec3());
    let x = v.dot(view.right.as_dvec3()) / (z * tan * size.x / size.y);
    let y = v.dot(view.up.as_dvec3()) / (z * tan);
    DVec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y) * size
}

/// Compares motion vectors. At least `least_moved` pixels must be on dynamic geometry.
fn hold(subject: &Subject, last_s: f64, now_s: f64, least_moved: usize) {
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.buffers.aovs = vec![Aov::Motion];
    let mut stage = Stage::alone(subject, &settings);
    stage.frame_at(last_s, 0);
    let centre = {
        let frame = stage.frame_at(now_s, 1);
        DVec2::from(frame.report.pixel_centre.map(f64::from))
    };
    let motion = stage.aov(0);
    let [now, last] = [now_s, last_s].map(|time_s| triangles(&subject.scene.at(time_s)));
    let mut moved = 0;
    for (eye, planes) in [(Eye::LEFT, motion.left()), (Eye::RIGHT, motion.right())] {
        let [view, before] = [now_s, last_s].map(|time_s| subject.rig.view(time_s, eye));
        let mut wrong = Vec::new();
        for (at, (dx, dy)) in planes[0].iter().zip(&planes[1]).enumerate() {
            let (x, y) = (at as u32 % EXTENT.width, at as u32 / EXTENT.width);
            let through = DVec2::new(x.into(), y.into()) + centre;
            let direction = view.ray_direction(through.x, through.y, EXTENT);
            let Some((triangle, weights)) = meets(&now, view.origin.as_dvec3(), direction) else { continue };
            let point = |corners: &[DVec3; 3]| corners.iter().zip(weights).map(|(c, w)| *c * w).sum::<DVec3>();
            let (is, was) = (point(&now[triangle]), point(&last[triangle]));
            let expected = pixel(&before, was) - through;
            let found = DVec2::new((*dx).into(), (*dy).into());
            moved += usize::from(is.distance(was) > 1e-3);
            if found.distance(expected) > 0.01 + 0.002 * expected.length() {
                wrong.push((x, y, found, expected));
            }
        }
        // Rays through edges may hit a triangle in one place and its neighbour in the other.
        println!("{} at {now_s} s, {eye} eye: {} pixels differ", subject.name, wrong.len());
        assert!(wrong.len() < EXTENT.area() / 500, "{}: {} pixels, as {:?}", subject.name, wrong.len(), &wrong[..5]);
    }
    assert!(moved >= least_moved, "{}: {moved} pixels are on what moves", subject.name);
}

#[test]
fn motion_vectors_lead_to_previous_surfaces() {
    for scene in [moving::skinned(), moving::morphed(), moving::rigid(), moving::emissive()] {
        hold(&watched(scene), 0.4, 0.43, 300);
    }
}

/// In the second scene, only the eyes and a lamp move.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn motion_vectors_include_the_motion_of_eyes() {
    let mut lit = moving::switched();
    for light in &mut lit.lights {
        light.kind = LightKind::Point { position: Vec3::Y * 2.0, radius: 0.0 };
    }
    for (scene, least_moved) in [(moving::everything(), 300), (lit, 0)] {
        let mut subject = watched(scene);
        subject.rig.baseline_m = 0.1;
        let first = subject.rig.keys[0];
        let by = DVec3::new(0.3, 0.1, -0.4);
        subject.rig.keys.push(RigKey { time_s: 1.0, position: first.position + by, target: first.target, ..first });
        hold(&subject, 0.5, 0.55, least_moved);
    }
}
