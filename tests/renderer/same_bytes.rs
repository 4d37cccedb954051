//! N devices give the same bytes as one for any distribution of rows, and so do more general shaders and those with
//! more checks.

mod needs;
mod quality;

use crate::common::{Stage, Subject, devices_to_lose, foveate, is_thorough, project, shared_shot};
use diptych::RunConfig;
use diptych::device::{ShaderChecks, Tables};
use diptych::exec::Stereo;
use diptych::frame::{Foveation, Sampler};
use diptych::graph::{Assignment, HaloPlan, Seam};
use diptych::image::RgbImage;
use diptych::projection::{LogPolar, PolarSpace};
use diptych::quality::{Denoiser, Filter, Quality};
use diptych::scene::shot::Gaze;
use diptych::schedule::{CostModel, Even, Heft, Measured, Policy, Static};

pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 72;

/// Asserts that both images are equal bit by bit.
#[track_caller]
pub fn assert_same(what: &str, expected: &Stereo<RgbImage>, found: &Stereo<RgbImage>) {
    for (eye, a, b) in [("left", &expected.left, &found.left), ("right", &expected.right, &found.right)] {
        assert_eq!(a.extent, b.extent);
        let differs = |i: &usize| a.pixels[*i].map(f32::to_bits) != b.pixels[*i].map(f32::to_bits);
        let wrong: Vec<usize> = (0..a.extent.area()).filter(differs).collect();
        if let Some(&first) = wrong.first() {
            let width = a.extent.width as usize;
            let mut rows: Vec<usize> = wrong.iter().map(|i| i / width).collect();
            rows.dedup();
            panic!(
                "{what}: {} pixels of the {eye} eye differ, the first at ({}, {}): {:?} is not {:?}; rows {rows:?}",
                wrong.len(),
                first % width,
                first / width,
                b.pixels[first],
                a.pixels[first]
            );
        }
    }
    let lit = |image: &RgbImage| image.pixels.iter().filter(|p| **p != [0.0; 3]).count() * 4 > image.extent.area();
    assert!(lit(&expected.left) && lit(&expected.right), "{what}: there is nothing to see");
}

pub fn ratios(devices: usize, rules: &[&str]) -> Box<dyn Policy> {
    let rules: Vec<_> = rules.iter().map(|r| r.parse().unwrap()).collect();
    Box::new(Static::new(HEIGHT, devices, &rules).unwrap())
}

/// Renders a frame on one device, then on several with even stripes.
fn hold_against_one_device(subject: &Subject, settings: &RunConfig, counts: &[usize]) {
    let one = Stage::even(subject, settings, 1).frame(0).linear;
    for &devices in counts {
        let found = Stage::even(subject, settings, devices).frame(0).linear;
        assert_same(&format!("{}, {devices} even stripes", subject.name), &one, &found);
    }
}

#[test]
fn same_bytes_on_two_to_four_devices() {
    // Opening devices takes longer than rendering on them.
    for (shot, counts) in [("builtin:atrium", &[3][..]), ("builtin:checker", &[2, 4])] {
        let subject = Subject::load(shot);
        hold_against_one_device(&subject, &subject.denoised(WIDTH, HEIGHT), counts);
    }
}

#[test]
fn same_bytes_of_polar_images_while_the_gaze_moves() {
    let visual = |denoiser| (PolarSpace::Visual, denoiser);
    let composite = |denoiser| (PolarSpace::Log(LogPolar::COMPOSITE), denoiser);
    let all = [
        ("builtin:atrium", visual(Denoiser::SVGF), true, 3),
        ("builtin:checker", composite(Denoiser::BMFR), false, 2),
        ("builtin:checker", visual(Denoiser::BMFR), false, 2),
        ("builtin:atrium", composite(Denoiser::SVGF), true, 3),
    ];
    let count = if is_thorough() { all.len() } else { 2 };
    for (shot, (space, denoiser), reproject, devices) in all.into_iter().take(count) {
        let subject = Subject::load(shot);
        let mut settings = subject.accumulated(WIDTH, HEIGHT);
        let towards = |x: f64| Gaze { path: vec![[0.0, x, 0.4], [0.05, x + 0.1, 0.5], [0.06, 0.9, 0.1]] };
        let gaze = [towards(0.4), towards(0.3)];
        project(&mut settings, gaze, space);
        (settings.buffers.reproject, settings.envelope.most.filter) = (reproject, Some(Filter::new(denoiser, 5)));
        let [one, several] = [1, devices].map(|devices| {
            let mut stage = Stage::even(&subject, &settings, devices);
            (0..6).map(|index| stage.frame_at(f64::from(index) * 0.015, index)).collect::<Vec<_>>()
        });
        for (index, (expected, found)) in one.iter().zip(&several).enumerate() {
            assert_same(
                &format!("{shot}, {space}, frame {index} on {devices} devices"),
                &expected.linear,
                &found.linear,
            );
            assert_eq!(expected.report.tallies, found.report.tallies, "{shot}, frame {index}");
            let dropped = expected.report.tallies.map(|tally| tally.nonfinite);
            assert_eq!(dropped, [0, 0], "{shot}, frame {index}");
        }
    }
}

/// A policy that assigns each frame by the next of several policies.
pub struct Script {
    frames: std::vec::IntoIter<Box<dyn Policy>>,
}

impl Script {
    pub fn new(frames: Vec<Box<dyn Policy>>) -> Self {
        Self { frames: frames.into_iter() }
    }
}

impl Policy for Script {
    fn name(&self) -> &'static str {
        "script"
    }

    fn assign(&mut self, model: &CostModel) -> Assignment {
        self.frames.next().expect("a policy for every frame").assign(model)
    }

    fn remove_device(&mut self, device: usize) {
        panic!("device {device} failed");
    }
}

#[test]
fn same_bytes_with_uneven_and_empty_stripes() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let one = Stage::even(&subject, &settings, 1).frame(0).linear;
    let all = ["5,1,2", "1,0,1", "0,0,1", "1,70,1"];
    let script: Vec<_> = all.iter().map(|rules| ratios(3, &[rules])).collect();
    let mut three = Stage::with(&subject, &settings, 3, Box::new(Script::new(script)));
    for rules in all {
        assert_same(&format!("ratios {rules}"), &one, &three.frame(0).linear);
    }
}

#[test]
fn same_bytes_with_stripes_per_stage_and_view() {
    let rules = [
        "gbuffer=1,2,1",
        "path_trace.left=5,1,2",
        "path_trace.right=1,1,6",
        "reproject=3,1,1",
        "atrous.left=1,1,2",
        "atrous.right=4,1,1",
        "tonemap=1,8,3",
    ];
    let subject = Subject::load("builtin:checker");
    for reproject in [true, false] {
        let mut settings = subject.denoised(WIDTH, HEIGHT);
        settings.buffers.reproject = reproject;
        let one = Stage::even(&subject, &settings, 1).frame(0).linear;
        for plan in [HaloPlan::RECOMPUTE, HaloPlan::EXCHANGE] {
            settings.execution.seam = Seam::Halo(plan);
            let found = Stage::with(&subject, &settings, 3, ratios(3, &rules)).frame(0).linear;
            assert_same(&format!("reproject {reproject}, {plan:?}"), &one, &found);
        }
    }
}

#[test]
fn same_bytes_with_learned_stripes_on_a_camera_path() {
    let subject = Subject::load("builtin:atrium");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let frames = |devices: usize, policy: Box<dyn Policy>| {
        let mut stage = Stage::with(&subject, &settings, devices, policy);
        (0..5).map(|i| stage.frame_at(f64::from(i) * 0.7, i)).collect::<Vec<_>>()
    };
    let one = frames(1, Box::new(Measured::new(HEIGHT, 1)));
    assert!(one[0].linear.left != one[1].linear.left, "the camera stood still");
    let policies: [Box<dyn Policy>; 2] = [Box::new(Measured::new(HEIGHT, 3)), Box::new(Heft::new(HEIGHT, 3))];
    for policy in policies {
        let name = policy.name();
        let three = frames(3, policy);
        for (a, b) in one.iter().zip(&three) {
            assert_same(&format!("{name}, frame {}", a.report.index), &a.linear, &b.linear);
        }
        let edges: Vec<_> = three.iter().map(|f| f.report.stripe_edges()).collect();
        assert!(edges.iter().any(|e| *e != edges[0]), "{name}: no stripe moved: {edges:?}");
    }
}

/// Frames are close enough for temporal reuse, on stripes that jump and vanish.
#[test]
fn same_bytes_if_history_crosses_stripes() {
    for (name, gloss) in [("builtin:atrium", true), ("builtin:cornell", false)] {
        let subject = Subject::load(name);
        assert_eq!(subject.needs.gloss, gloss, "{name}");
        hold_history_against_one_device(&subject, Denoiser::SVGF);
    }
}

/// Blocks of 32 rows are displaced in each frame, larger than some stripes, and straddle others.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_if_blocks_straddle_stripes() {
    let subject = Subject::load("builtin:cornell");
    for denoiser in [Denoiser::BMFR, Denoiser::BMFR_NOISE] {
        hold_history_against_one_device(&subject, denoiser);
    }
}

fn hold_history_against_one_device(subject: &Subject, denoiser: Denoiser) {
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    settings.envelope.most.filter = Some(Filter::new(denoiser, 5));
    let times_s: Vec<f64> = (0..6).map(|i| f64::from(i) * 0.05).collect();
    let one = Stage::with(subject, &settings, 1, Box::new(Measured::new(HEIGHT, 1))).frames_in_flight(&times_s);
    let history: Vec<_> = one.iter().map(|f| f.report.spec.history_rows).collect();
    assert!(history[0].is_none() && history[1..].iter().all(Option::is_some), "{history:?}");
    let fresh = Stage::even(subject, &settings, 1).frame_at(times_s[5], 5).linear;
    assert!(one[5].linear.left != fresh.left && one[5].linear.right != fresh.right, "history changes nothing");
    let rules = ["1,1,1", "5,1,2", "1,0,1", "1,2,9", "1,2,9", "atrous.left=1,9,1"];
    for (plan, in_flight) in [(HaloPlan::RECOMPUTE, 1), (HaloPlan::EXCHANGE, 3)] {
        settings.execution.seam = Seam::Halo(plan);
        settings.execution.adapts_halo = false;
        settings.execution.frames_in_flight = in_flight;
        let script: Vec<_> = rules.iter().map(|rule| ratios(3, &[rule])).collect();
        let script = Box::new(Script::new(script));
        let three = Stage::with(subject, &settings, 3, script).frames_in_flight(&times_s);
        for (a, b) in one.iter().zip(&three) {
            assert_same(&format!("{}, {plan:?}, frame {}", subject.name, a.report.index), &a.linear, &b.linear);
        }
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_with_layers_around_a_moving_gaze() {
    let subject = Subject::load("builtin:checker");
    let path = vec![[0.0, 0.1, 0.9], [2.0, 0.9, 0.0]];
    let gaze = [Gaze { path }, Gaze { path: vec![[0.0, 0.4, 0.2]] }];
    for (spp, reproject, plan) in [(1, true, HaloPlan::RECOMPUTE), (3, false, HaloPlan::EXCHANGE)] {
        let mut settings = subject.denoised(WIDTH, HEIGHT);
        foveate(&mut settings, gaze.clone(), Foveation::default(), [2, 3, 5]);
        (settings.envelope.most.spp, settings.buffers.reproject) = (spp.into(), reproject);
        (settings.execution.seam, settings.execution.adapts_halo) = (Seam::Halo(plan), false);
        let frames = |devices: usize| {
            let mut stage = Stage::with(&subject, &settings, devices, Box::new(Measured::new(HEIGHT, devices)));
            (0..4).map(|i| stage.frame_at(f64::from(i) * 0.6, i)).collect::<Vec<_>>()
        };
        let one = frames(1);
        for devices in [2, 4] {
            for (a, b) in one.iter().zip(&frames(devices)) {
                let what = format!("{spp} spp, reproject {reproject}, {devices} devices, frame {}", a.report.index);
                assert_same(&what, &a.linear, &b.linear);
            }
        }
    }
}

#[test]
fn same_bytes_with_frames_in_flight() {
    let subject = Subject::load("builtin:checker");
    let times_s: Vec<f64> = (0..7).map(|i| f64::from(i) * 0.4).collect();
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    let alone = Stage::with(&subject, &settings, 1, Box::new(Measured::new(HEIGHT, 1))).frames_in_flight(&times_s);
    assert!(alone.iter().all(|f| !f.report.overlapped));
    for (in_flight, devices) in [(2, 1), (3, 3)] {
        settings.execution.frames_in_flight = in_flight;
        let policy = Box::new(Measured::new(HEIGHT, devices));
        let frames = Stage::with(&subject, &settings, devices, policy).frames_in_flight(&times_s);
        assert_eq!(frames.len(), alone.len());
        for (one, other) in alone.iter().zip(&frames) {
            assert!(other.report.overlapped);
            assert_eq!(one.report.index, other.report.index);
            assert_same(&format!("frame {} of {in_flight} in flight", one.report.index), &one.linear, &other.linear);
        }
    }
}

/// Samples, bounces, iterations, render scale and foveal radii of a frame.
type Numbers = (f64, u32, u32, f64, Option<[f64; 2]>);

#[test]
fn same_bytes_with_all_halo_plans() {
    let subject = Subject::load("builtin:cornell");
    const ITERATIONS: u32 = 3;
    let render = |plan, devices| {
        let mut settings = subject.denoised(WIDTH, HEIGHT);
        settings.envelope.most.filter = Some(Filter::new(Denoiser::ATROUS, ITERATIONS));
        settings.execution.seam = Seam::Halo(plan);
        settings.execution.adapts_halo = false;
        Stage::even(&subject, &settings, devices).frame(0).linear
    };
    let one = render(HaloPlan::RECOMPUTE, 1);
    for plan in HaloPlan::all(ITERATIONS as usize) {
        assert_same(&format!("{plan:?} on 4"), &one, &render(plan, 4));
    }
}

#[test]
fn same_bytes_with_any_seed_sampler_and_spp() {
    let subject = Subject::load("builtin:checker");
    let mut last: Option<Stereo<RgbImage>> = None;
    for (seed, spp, sampler, reproject) in
        [(7, 3, Sampler::Sobol, true), (0xffff_ffff, 3, Sampler::Pcg, false), (12345, 1, Sampler::Pcg, true)]
    {
        let mut settings = subject.denoised(WIDTH, HEIGHT);
        settings.seed = seed;
        settings.envelope.most.spp = spp.into();
        settings.sampler = sampler;
        settings.buffers.reproject = reproject;
        let one = Stage::even(&subject, &settings, 1).frame(0).linear;
        let three = Stage::even(&subject, &settings, 3).frame(0).linear;
        assert_same(&format!("seed {seed}, {spp} spp"), &one, &three);
        assert!(last.is_none_or(|l| l.left != one.left), "seed {seed} changes nothing");
        last = Some(one);
    }
}

#[test]
fn same_bytes_of_very_short_or_narrow_frames() {
    let subject = Subject::load("builtin:checker");
    for (width, height, devices) in [(50, 3, 4), (1, 40, 2)] {
        let settings = subject.denoised(width, height);
        let one = Stage::even(&subject, &settings, 1).frame(0).linear;
        let several = Stage::even(&subject, &settings, devices).frame(0).linear;
        assert_same(&format!("{width}x{height}"), &one, &several);
    }
}

#[test]
#[ignore = "needs scenes of others: `make test-full` says which are there"]
fn same_bytes_of_scenes_from_files() {
    for name in ["garage", "ww2-cityscene"] {
        if let Some(shot) = shared_shot(name) {
            let subject = Subject::load(&shot);
            hold_against_one_device(&subject, &subject.denoised(WIDTH, HEIGHT), &[3]);
        }
    }
}

#[test]
fn same_bytes_with_full_shader_checks() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    let fast = Stage::alone(&subject, &settings).frame(0).linear;
    settings.execution.checks = ShaderChecks::Full;
    let full = Stage::alone(&subject, &settings).frame(0).linear;
    assert_same("full checks", &fast, &full);
}

/// Tables in buffers, as on GPUs, and in textures, as on lavapipe, give the same bytes.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_with_tables_in_buffer_or_texture() {
    // Instances in animated scenes are covered by the test of tables that change.
    for shot in ["builtin:atrium", "builtin:forest"].into_iter().take(if is_thorough() { 2 } else { 1 }) {
        let subject = Subject::load(shot);
        let settings = subject.accumulated(WIDTH, HEIGHT);
        let render = |tables| {
            let mut gpus = devices_to_lose(1);
            gpus[0].quirks.tables = tables;
            gpus[0].pipelines.clear();
            let mut stage = Stage::on(gpus, &subject, &settings, Box::new(Even::new(HEIGHT, 1)));
            let frames = [0, 1].map(|frame| stage.frame(frame).linear);
            stage.into_devices();
            frames
        };
        let (buffer, texture) = (render(Tables::Buffer), render(Tables::Texture));
        for (a, b) in buffer.iter().zip(&texture) {
            assert_same(shot, a, b);
        }
    }
}
