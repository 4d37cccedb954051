//! Animated scenes: the same bytes on any devices, the light of a static scene at each instant, and a history that
//! follows surfaces.

mod followed;
mod history;
mod resting;
mod rungs;
mod twins;

use crate::common::{Stage, Subject};
use crate::pictures::seen;
use crate::reference::scenes::{add_matte, add_mesh, moving, quad};
use diptych::scene::Scene;
use diptych::scene::motion::Target;
use diptych::scene::motion::keys::Interpolation;
use glam::{DVec3, Vec3};

/// Returns the scene with static eyes in one place.
pub fn watched(scene: Scene) -> Subject {
    seen((scene, moving::camera()))
}

/// Times from 0.1 on, so that the lamp of [`moving::everything`] switches after the first frames.
pub fn times_s() -> Vec<f64> {
    (0..6).map(|i| 0.1 + f64::from(i) * 0.015).collect()
}

/// A body that shrinks to nothing in the middle of its motion is counted there, and nowhere else.
#[test]
fn omitted_bodies_are_counted_per_frame() {
    let mut draft = moving::Draft::room("shrinking");
    let red = add_matte(&mut draft.scene, Vec3::new(0.8, 0.2, 0.2));
    let corner = Vec3::new(-0.5, -0.5, 0.0);
    let mesh = add_mesh(&mut draft.scene, quad(corner, Vec3::X, Vec3::Y, red));
    for (x, shrinks) in [(-0.7, true), (0.7, false)] {
        let node = draft.node(None, DVec3::new(x, 0.9, 0.0), DVec3::ONE);
        let least = if shrinks { 0.0 } else { 0.1 };
        let scales = [[1.0; 3], [least; 3], [1.0; 3]].concat();
        draft.animate(Target::Scale(node), Interpolation::Linear, &[0.0, 1.0, 2.0], &scales);
        draft.body(mesh, node, None, Vec::new());
    }
    let subject = watched(draft.done());
    let settings = subject.settings(32, 24);
    let mut stage = Stage::alone(&subject, &settings);
    for (index, (time_s, expected)) in (0..).zip([(0.0, 0), (0.5, 0), (1.0, 1), (1.5, 0), (3.0, 1)]) {
        let report = stage.frame_at(time_s, index).report;
        assert_eq!(report.bodies_left_out, expected, "{time_s} s");
    }
}
