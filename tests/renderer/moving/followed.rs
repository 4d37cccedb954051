//! Motion vectors agree with the surface positions in the previous frame, as computed on the host.

use crate::common::{Stage, Subject};
use crate::pictures::seen_at;
use crate::reference::intersect::{Geometry, Ray, Triangle};
use crate::reference::scenes::moving;
use crate::reference::surface::Surfaces;
use diptych::image::Extent;
use diptych::passes::Aov;
use diptych::scene::LightKind;
use diptych::scene::rig::RigKey;
use glam::{DVec2, DVec3, Vec3};

use super::watched;

const EXTENT: Extent = Extent::new(96, 64);

/// Compares motion vectors. At least `least_moved` pixels must be on dynamic geometry.
fn hold(subject: &Subject, last_s: f64, now_s: f64, least_moved: usize) {
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.buffers.aovs = vec![Aov::Motion];
    let mut stage = Stage::alone(subject, &settings);
    stage.frame_at(last_s, 0);
    let centre = DVec2::from(stage.frame_at(now_s, 1).report.pixel_centre.map(f64::from));
    let motion = stage.aov(0);
    let [now, last] = [now_s, last_s].map(|time_s| Surfaces::new(&subject.scene.at(time_s)).triangles());
    let now = Geometry::new(now);
    let mut moved = 0;
    for (eye, planes) in motion.with_eyes() {
        let [view, before] = [now_s, last_s].map(|time_s| subject.rig.view(time_s, eye));
        let mut wrong = Vec::new();
        for (at, (dx, dy)) in planes[0].iter().zip(&planes[1]).enumerate() {
            let (x, y) = (at as u32 % EXTENT.width, at as u32 / EXTENT.width);
            let through = DVec2::new(x.into(), y.into()) + centre;
            let (origin, direction) = (view.origin.as_dvec3(), view.ray_direction(through.x, through.y, EXTENT));
            let ray = Ray { origin, direction };
            let Some(hit) = now.closest(&ray, f64::INFINITY, None, |_, _| true) else { continue };
            let point = |of: &Triangle| of.vertices.iter().zip(hit.weights).map(|(c, w)| *c * w).sum::<DVec3>();
            let [is, was] = [&now.triangles, &last].map(|triangles| point(&triangles[hit.triangle]));
            let expected = seen_at(&before, was, EXTENT) - through;
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
