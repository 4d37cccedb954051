//! Every device updates the animated scene by itself, and all get the same result.

use crate::common::{Frame, Stage, devices_to_lose, is_thorough, sampled};
use crate::reference::scenes::moving;
use crate::same_bytes::{HEIGHT, Script, WIDTH, assert_same, ratios};
use diptych::RunConfig;
use diptych::device::{Tables, Traversal};
use diptych::exec::InjectedFaults;
use diptych::graph::{HaloPlan, Seam};
use diptych::quality::{Denoiser, Filter};
use diptych::samples::Samples;
use diptych::scene::motion::{Attached, Motion};
use diptych::schedule::{Even, Measured, Policy};

use super::watched;

const FRAMES: usize = 6;

/// Times from 0.1 on, so that the scene's lamp switches after the first frames.
fn times_s() -> Vec<f64> {
    (0..FRAMES).map(|i| 0.1 + i as f64 * 0.015).collect()
}

#[track_caller]
fn assert_all_same(what: &str, expected: &[Frame], found: &[Frame]) {
    assert_eq!(expected.len(), found.len());
    for (a, b) in expected.iter().zip(found) {
        assert_same(&format!("{what}, frame {}", a.report.index), &a.linear, &b.linear);
    }
}

#[test]
fn same_bytes_of_moving_scenes_on_moving_stripes() {
    for (denoiser, spp) in sampled([(Denoiser::SVGF, 1.5), (Denoiser::SVGF, 1.0), (Denoiser::BMFR, 1.0)], 2) {
        hold_motion_against_one_device(denoiser, spp);
    }
}

fn hold_motion_against_one_device(denoiser: Denoiser, spp: f64) {
    let subject = watched(moving::everything());
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    settings.envelope.most.filter = Some(Filter::new(denoiser, 5));
    (settings.envelope.most.spp, settings.envelope.mixes_spp) = (Samples::of_mean(spp), spp > 1.0);
    let times_s = times_s();
    let one = Stage::with(&subject, &settings, 1, Box::new(Measured::new(HEIGHT, 1))).frames_in_flight(&times_s);
    assert!(one.windows(2).all(|w| w[0].linear.left != w[1].linear.left), "nothing moves");
    let history: Vec<_> = one.iter().map(|f| f.report.spec.history_rows).collect();
    assert!(history[0].is_none() && history[1..].iter().all(Option::is_some), "{history:?}");
    let fresh = Stage::even(&subject, &settings, 1).frame_at(times_s[5], 5).linear;
    assert!(one[5].linear.left != fresh.left && one[5].linear.right != fresh.right, "history changes nothing");

    let rules = ["1,1,1", "5,1,2", "1,0,1", "1,2,9", "1,2,9", "atrous.left=1,9,1"];
    let script: Vec<_> = rules.iter().map(|rule| ratios(3, &[rule])).collect();
    let measured = |devices| -> Box<dyn Policy> { Box::new(Measured::new(HEIGHT, devices)) };
    let script: Box<dyn Policy> = Box::new(Script::new(script));
    let all = [
        (3, 3, script, HaloPlan::EXCHANGE),
        (2, 2, measured(2), HaloPlan::RECOMPUTE),
        (4, 1, measured(4), HaloPlan::RECOMPUTE),
    ];
    // A fourth device would have to compile all shaders.
    let count = if is_thorough() { all.len() } else { 2 };
    for (devices, in_flight, policy, plan) in all.into_iter().take(count) {
        (settings.execution.seam, settings.execution.adapts_halo) = (Seam::Halo(plan), false);
        settings.execution.frames_in_flight = in_flight;
        let found = Stage::with(&subject, &settings, devices, policy).frames_in_flight(&times_s);
        assert_all_same(&format!("{devices} devices, {in_flight} in flight"), &one, &found);
    }
}

/// The scene has the frame's time, however often the frame restarts.
#[test]
fn same_bytes_of_moving_scenes_after_device_loss() {
    let subject = watched(moving::everything());
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    let times_s = times_s();
    let expected = Stage::alone(&subject, &settings).frames_in_flight(&times_s);
    for in_flight in [1, 3] {
        settings.execution.frames_in_flight = in_flight;
        let mut three = Stage::on(devices_to_lose(3), &subject, &settings, Box::new(Measured::new(HEIGHT, 3)));
        let injections = vec!["loss:dev1@frame3".parse().unwrap()];
        three.renderer().set_injected_faults(InjectedFaults { injections, slowdown: Vec::new() });
        let found = three.frames_in_flight(&times_s);
        assert_eq!(three.renderer().faults().len(), 1);
        assert_all_same(&format!("{in_flight} in flight"), &expected, &found);
    }
}

/// Tables in buffers, as on GPUs, and in textures, as on lavapipe, give the same bytes.
#[test]
fn same_bytes_of_dynamic_tables_in_textures() {
    let subject = watched(moving::everything());
    let settings = subject.accumulated(WIDTH, HEIGHT);
    let render = |tables| {
        let mut gpus = devices_to_lose(1);
        gpus[0].quirks.tables = tables;
        gpus[0].pipelines.clear();
        let mut stage = Stage::on(gpus, &subject, &settings, Box::new(Even::new(HEIGHT, 1)));
        let frames = times_s()[..3].iter().zip(0..).map(|(t, i)| stage.frame_at(*t, i)).collect::<Vec<_>>();
        stage.into_devices();
        frames
    };
    assert_all_same("a texture", &render(Tables::Buffer), &render(Tables::Texture));
}

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
    assert_all_same("lights that could move", &still[..1], &moving[..1]);
    let filter = |settings: &mut RunConfig| settings.envelope.most.filter = Some(Filter::new(Denoiser::ATROUS, 5));
    let unfiltered = frames(could, filter);
    assert_all_same("lights that could move, without history", &frames(scene.at(0.0), filter), &unfiltered);
    assert!(unfiltered.iter().all(|frame| stages(frame).is_empty()), "nothing reads where surfaces were");
    let deforming = frames(moving::skinned(), |_| {});
    // Devices with ray queries have structures of their own, which `skin` builds, and need no refitted trees.
    let is_hardware = devices_to_lose(1)[0].info.traversal == Traversal::Hardware;
    let first = if is_hardware { &["skin", "motion"] } else { &["skin", "refit"] };
    assert!(deforming.iter().all(|frame| stages(frame)[..2] == first[..]), "{:?}", stages(&deforming[0]));
}
