//! Cases: scenes and settings, with the runs that must have the bytes of one device.

use super::Rows::{Even, Measured, Ratios, Turns};
use super::*;
use crate::common::{devices_to_lose, foveate, is_thorough, project, sampled, shared_shot, with};
use crate::reference::scenes::moving::everything;
use crate::{eyes, instances, mirrors, moving, textures};
use diptych::device::{ShaderChecks, Tables};
use diptych::frame::{Foveation, Sampler};
use diptych::projection::{LogPolar, PolarSpace};
use diptych::quality::{Denoiser, Filter};
use diptych::samples::Samples;
use diptych::scene::shot::Gaze;

const RECOMPUTE: HaloPlan = HaloPlan::RECOMPUTE;
const EXCHANGE: HaloPlan = HaloPlan::EXCHANGE;

fn denoised_by(denoiser: Denoiser, mut settings: RunConfig) -> RunConfig {
    settings.envelope.most.filter = Some(Filter::new(denoiser, 5));
    settings
}

#[test]
fn same_bytes_on_two_to_four_devices() {
    // Opening devices takes longer than rendering on them.
    for (shot, runs) in [("builtin:atrium", &[even(3)][..]), ("builtin:checker", &[even(2), even(4)])] {
        let subject = Subject::load(shot);
        hold(shot, &subject, &subject.denoised(WIDTH, HEIGHT), &[0.0], runs);
    }
}

#[test]
#[ignore = "needs scenes of others: `make test-full` says which are there"]
fn same_bytes_of_scenes_from_files() {
    for shot in ["garage", "ww2-cityscene"].into_iter().filter_map(shared_shot) {
        let subject = Subject::load(&shot);
        hold(&shot, &subject, &subject.denoised(WIDTH, HEIGHT), &[0.0], &[even(3)]);
    }
}

#[test]
fn same_bytes_of_instances_mirrors_and_tiles() {
    let crowd = instances::subject(&instances::crowd(), diptych::accel::Layout::TwoLevel, glam::Vec3::ZERO);
    hold("crowd", &crowd, &crowd.denoised(96, 64), &[0.0], &[even(2)]);
    let tiles = textures::floor("tiles", |_| ());
    let filtered = RunConfig { filter_textures: true, ..tiles.accumulated(64, 48) };
    hold("tiles", &tiles, &filtered, &[0.0], &[even(3)]);
    let [hall, room] = [mirrors::hall_of_mirrors(), mirrors::moving_room(mirrors::Wall::Mirror)];
    let of_hall = [(&hall, Denoiser::SVGF, 1), (&hall, Denoiser::BMFR, 1), (&hall, Denoiser::SVGF, 2)];
    let of_room = [(&room, Denoiser::SVGF, 1), (&room, Denoiser::BMFR, 1)];
    for (subject, denoiser, spp) in sampled(of_hall.into_iter().chain(of_room), 4) {
        let settings = with(mirrors::settings(subject, denoiser), |config| config.envelope.most.spp = spp.into());
        let case = format!("{}, {denoiser:?}, {spp} spp", subject.name);
        hold(&case, subject, &settings, &every(1.0 / mirrors::FPS, 3), &[even(3)]);
    }
}

#[test]
fn same_bytes_of_very_short_or_narrow_frames() {
    let subject = Subject::load("builtin:checker");
    for (width, height, devices) in [(50, 3, 4), (1, 40, 2)] {
        let case = format!("{width}x{height}");
        hold(&case, &subject, &subject.denoised(width, height), &[0.0], &[even(devices)]);
    }
}

#[test]
fn same_bytes_with_any_seed_sampler_and_spp() {
    let subject = Subject::load("builtin:checker");
    let mut last: Option<PerView<RgbImage>> = None;
    for (seed, spp, sampler, reproject) in
        [(7, 3, Sampler::Sobol, true), (0xffff_ffff, 3, Sampler::Pcg, false), (12345, 1, Sampler::Pcg, true)]
    {
        let mut settings = RunConfig { seed, sampler, ..subject.denoised(WIDTH, HEIGHT) };
        (settings.envelope.most.spp, settings.buffers.reproject) = (spp.into(), reproject);
        let one = hold(&format!("seed {seed}, {spp} spp"), &subject, &settings, &[0.0], &[even(3)]).remove(0).linear;
        assert!(last.is_none_or(|l| l.left() != one.left()), "seed {seed} changes nothing");
        last = Some(one);
    }
}

#[test]
fn same_bytes_of_polar_images_while_the_gaze_moves() {
    let composite = PolarSpace::Log(LogPolar::COMPOSITE);
    let all = [
        ("builtin:atrium", PolarSpace::Visual, Denoiser::SVGF, true, 3),
        ("builtin:checker", composite, Denoiser::BMFR, false, 2),
        ("builtin:checker", PolarSpace::Visual, Denoiser::BMFR, false, 2),
        ("builtin:atrium", composite, Denoiser::SVGF, true, 3),
    ];
    let count = if is_thorough() { all.len() } else { 2 };
    for (shot, space, denoiser, reproject, devices) in all.into_iter().take(count) {
        let subject = Subject::load(shot);
        let mut settings = denoised_by(denoiser, subject.accumulated(WIDTH, HEIGHT));
        let towards = |x: f64| Gaze { path: vec![[0.0, x, 0.4], [0.05, x + 0.1, 0.5], [0.06, 0.9, 0.1]] };
        project(&mut settings, [towards(0.4), towards(0.3)], space);
        settings.buffers.reproject = reproject;
        hold(&format!("{shot}, {space}"), &subject, &settings, &every(0.015, 6), &[even(devices)]);
    }
}

#[test]
fn same_bytes_of_resampled_eyes_on_several_devices() {
    let (subject, settings) = eyes::shown("builtin:cornell", 40, 1);
    let kinds: [(_, fn(&mut RunConfig)); 4] = [
        ("layers", |config| foveate(config, eyes::gaze(), Foveation::default(), [1, 2, 3])),
        ("visual-polar", |config| project(config, eyes::gaze(), PolarSpace::Visual)),
        ("all alike", |_| ()),
        ("log-polar", |config| project(config, eyes::gaze(), PolarSpace::Log(LogPolar::COMPOSITE))),
    ];
    for (kind, change) in if is_thorough() { &kinds[..] } else { &kinds[..2] } {
        let mut settings = settings.clone();
        (settings.buffers.reproject, settings.envelope.most.filter) = (true, Some(Filter::new(Denoiser::SVGF, 3)));
        change(&mut settings);
        let [one, two, three] = [1, 2, 3].map(|devices| even(devices).frames(&subject, &settings, &every(0.02, 2)));
        assert_eq!(one[0].linear.left().extent, eyes::size(40));
        for (expected, found) in one.iter().chain(&one).zip(two.iter().chain(&three)) {
            assert_equal(kind, &expected.linear, &found.linear);
        }
    }
}

#[test]
fn same_bytes_with_uneven_and_empty_stripes() {
    let subject = Subject::load("builtin:checker");
    let turns = Turns(&["5,1,2", "1,0,1", "0,0,1", "1,70,1"]);
    hold("checker", &subject, &subject.denoised(WIDTH, HEIGHT), &[0.0; 4], &[run(3, turns)]);
}

/// Also on stripes that are narrower than the halo.
#[test]
fn same_bytes_with_stripes_per_stage_and_view() {
    let ratios = Ratios(&[
        "gbuffer=1,2,1",
        "path_trace.left=5,1,2",
        "path_trace.right=1,1,6",
        "reproject=3,1,1",
        "atrous.left=1,1,2",
        "atrous.right=4,1,1",
        "tonemap=1,8,3",
    ]);
    let narrow = Ratios(&["95,10,95"]);
    let subject = Subject::load("builtin:checker");
    for (width, height, reproject, rows) in
        [(WIDTH, HEIGHT, true, ratios), (WIDTH, HEIGHT, false, ratios), (32, 480, true, Even), (32, 200, true, narrow)]
    {
        let settings = with(subject.denoised(width, height), |config| config.buffers.reproject = reproject);
        let runs = [RECOMPUTE, EXCHANGE].map(|plan| run(3, rows).with(plan, 1));
        hold(&format!("{width}x{height}, reproject {reproject}"), &subject, &settings, &[0.0], &runs);
    }
}

#[test]
fn same_bytes_with_all_halo_plans() {
    const ITERATIONS: u32 = 3;
    let subject = Subject::load("builtin:cornell");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    settings.envelope.most.filter = Some(Filter::new(Denoiser::ATROUS, ITERATIONS));
    let runs: Vec<_> = HaloPlan::all(ITERATIONS as usize).map(|plan| even(4).with(plan, 1)).collect();
    hold("cornell", &subject, &settings, &[0.0], &runs);
}

#[test]
fn same_bytes_with_learned_stripes_on_a_camera_path() {
    let subject = Subject::load("builtin:atrium");
    let (settings, times_s) = (subject.denoised(WIDTH, HEIGHT), every(0.7, 5));
    let one = even(1).frames(&subject, &settings, &times_s);
    let three = run(3, Measured).frames(&subject, &settings, &times_s);
    assert_same_frames("measured", &one, &three);
    let edges: Vec<_> = three.iter().map(|f| f.report.stripe_edges()).collect();
    assert!(edges.iter().any(|e| *e != edges[0]), "no stripe moved: {edges:?}");
}

#[test]
fn same_bytes_with_frames_in_flight() {
    let subject = Subject::load("builtin:checker");
    let (settings, times_s) = (subject.denoised(WIDTH, HEIGHT), every(0.4, 7));
    let one = even(1).frames(&subject, &settings, &times_s);
    assert!(one.iter().all(|f| !f.report.overlapped));
    for (in_flight, devices) in [(2, 1), (3, 3)] {
        let found = Run { in_flight, ..run(devices, Measured) }.frames(&subject, &settings, &times_s);
        assert!(found.iter().all(|f| f.report.overlapped));
        assert_same_frames(&format!("{in_flight} in flight"), &one, &found);
    }
}

/// Stripes that jump and vanish.
const JUMPS: Rows = Turns(&["1,1,1", "5,1,2", "1,0,1", "1,2,9", "1,2,9", "atrous.left=1,9,1"]);

/// Holds six frames, each of which but the first has a history that changes it.
fn hold_history(case: &str, subject: &Subject, settings: &RunConfig, times_s: &[f64], runs: &[Run]) {
    let one = hold(case, subject, settings, times_s, runs);
    let history: Vec<_> = one.iter().map(|f| f.report.spec.history_rows).collect();
    assert!(history[0].is_none() && history[1..].iter().all(Option::is_some), "{case}: {history:?}");
    let fresh = Stage::even(subject, settings, 1).frame_at(times_s[5], 5).linear;
    let is_changed = one[5].linear.left() != fresh.left() && one[5].linear.right() != fresh.right();
    assert!(is_changed, "{case}: history changes nothing");
}

fn hold_history_of(shot: &str, gloss: bool, denoisers: &[Denoiser]) {
    let subject = Subject::load(shot);
    assert_eq!(subject.needs.gloss, gloss, "{shot}");
    for &denoiser in denoisers {
        let settings = denoised_by(denoiser, subject.accumulated(WIDTH, HEIGHT));
        let runs = [run(3, JUMPS).with(RECOMPUTE, 1), run(3, JUMPS).with(EXCHANGE, 3)];
        hold_history(&format!("{shot}, {denoiser:?}"), &subject, &settings, &every(0.05, 6), &runs);
    }
}

#[test]
fn same_bytes_if_history_crosses_stripes() {
    hold_history_of("builtin:atrium", true, &[Denoiser::SVGF]);
    hold_history_of("builtin:cornell", false, &[Denoiser::SVGF]);
}

/// Blocks of 32 rows are displaced in each frame, larger than some stripes, and straddle others.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_if_blocks_straddle_stripes() {
    hold_history_of("builtin:cornell", false, &[Denoiser::BMFR, Denoiser::BMFR_NOISE]);
}

/// The scene's lamp switches after the first frames.
#[test]
fn same_bytes_of_moving_scenes_on_moving_stripes() {
    let subject = moving::watched(everything());
    let mut runs = vec![run(3, JUMPS).with(EXCHANGE, 3), run(2, Measured).with(RECOMPUTE, 2)];
    // A fourth device would have to compile all shaders.
    runs.extend(is_thorough().then(|| run(4, Measured).with(RECOMPUTE, 1)));
    for (denoiser, spp) in sampled([(Denoiser::SVGF, 1.5), (Denoiser::SVGF, 1.0), (Denoiser::BMFR, 1.0)], 2) {
        let mut settings = denoised_by(denoiser, subject.accumulated(WIDTH, HEIGHT));
        (settings.envelope.most.spp, settings.envelope.mixes_spp) = (Samples::of_mean(spp), spp > 1.0);
        hold_history(&format!("{denoiser:?}, {spp} spp"), &subject, &settings, &moving::times_s(), &runs);
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_with_layers_around_a_moving_gaze() {
    let subject = Subject::load("builtin:checker");
    let gaze = [vec![[0.0, 0.1, 0.9], [2.0, 0.9, 0.0]], vec![[0.0, 0.4, 0.2]]].map(|path| Gaze { path });
    for (spp, reproject, plan) in [(1, true, RECOMPUTE), (3, false, EXCHANGE)] {
        let mut settings = subject.denoised(WIDTH, HEIGHT);
        foveate(&mut settings, gaze.clone(), Foveation::default(), [2, 3, 5]);
        (settings.envelope.most.spp, settings.buffers.reproject) = (spp.into(), reproject);
        let runs = [2, 4].map(|devices| run(devices, Measured).with(plan, 1));
        hold(&format!("{spp} spp, reproject {reproject}"), &subject, &settings, &every(0.6, 4), &runs);
    }
}

#[test]
fn same_bytes_with_full_shader_checks() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, HEIGHT);
    let fast = even(1).frames(&subject, &settings, &[0.0]);
    settings.execution.checks = ShaderChecks::Full;
    assert_same_frames("full checks", &fast, &even(1).frames(&subject, &settings, &[0.0]));
}

/// Asserts that tables in buffers, as on GPUs, and in textures, as on lavapipe, give the same bytes.
fn hold_tables(subject: &Subject, times_s: &[f64]) {
    let settings = subject.accumulated(WIDTH, HEIGHT);
    let [buffer, texture] = [Tables::Buffer, Tables::Texture].map(|tables| {
        let mut gpus = devices_to_lose(1);
        gpus[0].quirks.tables = tables;
        gpus[0].pipelines = Default::default();
        let mut stage = Stage::on(gpus, subject, &settings, Even.policy(HEIGHT, 1));
        let frames = stage.frames_in_flight(times_s);
        stage.into_devices();
        frames
    });
    assert_same_frames(&subject.name, &buffer, &texture);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_with_tables_in_buffer_or_texture() {
    // Instances in animated scenes are covered by the test of tables that change.
    for shot in ["builtin:atrium", "builtin:forest"] {
        hold_tables(&Subject::load(shot), &[0.0; 2]);
    }
}

#[test]
fn same_bytes_of_dynamic_tables_in_textures() {
    hold_tables(&moving::watched(everything()), &moving::times_s()[..3]);
}
