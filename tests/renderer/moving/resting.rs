//! Scenes in which nothing moves skip the passes of motion.

use super::watched;
use crate::common::{Frame, Stage, devices_to_lose};
use crate::reference::scenes::moving;
use crate::same_bytes::{HEIGHT, WIDTH, assert_same_frames};
use diptych::RunConfig;
use diptych::device::Traversal;
use diptych::quality::{Denoiser, Filter};
use diptych::scene::motion::{Attached, Motion};

fn frames(scene: diptych::scene::Scene, change: impl Fn(&mut RunConfig)) -> Vec<Frame> {
    let subject = watched(scene);
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    change(&mut settings);
    let mut stage = Stage::alone(&subject, &settings);
    (0..3).map(|i| stage.frame_at(0.1 * f64::from(i), i)).collect()
}

fn stages(frame: &Frame) -> Vec<&'static str> {
    let names = frame.report.program.passes().iter().map(|linked| linked.pass.stage.0);
    names.filter(|name| ["skin", "refit", "motion"].contains(name)).collect()
}

/// An animated scene at rest is lit identically, but TAA keeps a shorter history.
#[test]
fn static_scenes_skip_motion_passes_with_equal_light() {
    let scene = moving::lights();
    let still = frames(scene.at(0.0), |_| {});
    assert!(still.iter().all(|frame| stages(frame).is_empty()), "{:?}", stages(&still[0]));
    // All nodes are at rest, and lights stay in place.
    let mut could = scene.at(0.0);
    let nodes = scene.motion.nodes.clone();
    could.motion = Motion { nodes, lights: vec![Attached { index: 0, node: 0 }], ..Motion::default() };
    let translation = glam::dvec3(-1.0, 1.5, 0.8);
    could.motion.nodes[0].rest =
        diptych::scene::motion::Placement::Matrix(glam::DAffine3::from_translation(translation));
    let moving = frames(could.clone(), |_| {});
    assert!(moving.iter().all(|frame| stages(frame) == ["motion"; 2]), "{:?}", stages(&moving[0]));
    assert_same_frames("lights that could move", &still[..1], &moving[..1]);
    let filter = |settings: &mut RunConfig| settings.envelope.most.filter = Some(Filter::new(Denoiser::ATROUS, 5));
    let unfiltered = frames(could, filter);
    assert_same_frames("lights that could move, without history", &frames(scene.at(0.0), filter), &unfiltered);
    assert!(unfiltered.iter().all(|frame| stages(frame).is_empty()), "nothing reads where surfaces were");
    let deforming = frames(moving::skinned(), |_| {});
    // Devices with ray queries have structures of their own, which `skin` builds, and need no refitted trees.
    let is_hardware = devices_to_lose(1)[0].info.traversal == Traversal::Hardware;
    let first = if is_hardware { &["skin", "motion"] } else { &["skin", "refit"] };
    assert!(deforming.iter().all(|frame| stages(frame)[..2] == first[..]), "{:?}", stages(&deforming[0]));
}
