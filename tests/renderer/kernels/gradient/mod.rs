//! Temporal gradients.

mod twin;

use std::f64::consts::PI;
use std::ops::Range;

use diptych::accel::{Accel, Layout, SPHERE};
use diptych::layout::{Frame, History, PassConstants, Previous, Sampling};
use diptych::samples::{NO_CURVE, PixelSamples};
use diptych::scene::needs::SceneNeeds;
use diptych::scene::{Environment, Light as Lamp, LightKind, Material, Scene};
use glam::{DVec3, Vec3};

use self::twin::{Before, TILE, Twin, World};
use super::camera::{Constants, Eye, STORAGE_SCALE};
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Stripe, only_in};
use super::inputs::{Cases, HEIGHT, Random, WIDTH};
use super::pack::{Format, HALF, Light, NO_NORMAL, luminance, pack_guide};
use crate::common::{Subject, still_rig};
use crate::reference::scenes::{add_material, add_matte, empty, matte, place, quad};

/// Columns and rows of tiles.
const TILES: [u32; 2] = [WIDTH.div_ceil(TILE), HEIGHT.div_ceil(TILE)];

const SUN: DVec3 = DVec3::new(0.3, -0.5, -0.8);
const STRENGTH: DVec3 = DVec3::new(3.0, 2.5, 2.0);

/// Returns a folding screen in the sun behind a board. Its parts light one another.
fn screen() -> Scene {
    let mut scene = empty("folding screen");
    let [red, blue] = [Vec3::new(0.8, 0.3, 0.2), Vec3::new(0.1, 0.4, 0.9)].map(|c| add_matte(&mut scene, c));
    let up = Vec3::Y * 6.0;
    place(&mut scene, quad(Vec3::new(-4.0, -3.0, -2.4), Vec3::new(2.8, 0.0, -2.4), up, red));
    place(&mut scene, quad(Vec3::new(-1.2, -3.0, -4.8), Vec3::X * 2.2, up, blue));
    place(&mut scene, quad(Vec3::new(1.0, -3.0, -4.8), Vec3::new(2.8, 0.0, 2.4), up, red));
    place(&mut scene, quad(Vec3::new(-1.4, -0.5, -3.3), Vec3::X * 2.0, Vec3::Y * 2.2, blue));
    let kind = LightKind::Directional { direction: SUN.as_vec3().normalize(), angle_rad: 0.0 };
    scene.lights.push(Lamp { kind, strength: STRENGTH.as_vec3() });
    scene
}

/// Returns the screen with all kinds of lamps, some ambient light, and emissive parts.
fn lit_screen(gloss: bool) -> Scene {
    let mut scene = screen();
    if gloss {
        (scene.materials[0].specular, scene.materials[0].roughness) = (1.0, 0.4);
    }
    scene.environment = Environment::Constant(Vec3::new(0.1, 0.2, 0.3));
    let glow = add_material(&mut scene, Material { emissive: Vec3::splat(6.0), ..matte() });
    place(&mut scene, quad(Vec3::new(-0.5, 2.8, -4.0), Vec3::X, Vec3::Z, glow));
    let kind = LightKind::Point { position: Vec3::new(1.5, -1.5, -2.5), radius: 0.2 };
    scene.lights.push(Lamp { kind, strength: Vec3::splat(2.0) });
    scene
}

/// Returns a board near the eye with a lamp so close and bright that samples near it are not finite.
fn dazzled() -> Scene {
    let mut scene = empty("dazzled board");
    let grey = add_matte(&mut scene, Vec3::splat(0.5));
    place(&mut scene, quad(Vec3::new(-0.6, -0.3, -0.3), Vec3::X * 0.9, Vec3::Y * 0.9, grey));
    let kind = LightKind::Point { position: Vec3::new(-0.2, 0.1, -0.2), radius: 0.0 };
    scene.lights.push(Lamp { kind, strength: Vec3::splat(2e37) });
    scene
}

fn subject(scene: Scene, gloss: bool) -> (Subject, World) {
    let triangles = Accel::build_with(&scene, Layout::Flat).unwrap().triangles;
    let corners = triangles.iter().map(|t| [t.v0, t.v1, t.v2].map(Vec3::as_dvec3)).collect();
    let world = World { triangles: corners, sun: SUN.normalize(), strength: STRENGTH * f64::from(STORAGE_SCALE) };
    let rig = still_rig(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y, 0.5);
    let mut subject = Subject::laid_out("folding screen", scene, rig, Layout::Flat);
    // All scenes share a shader.
    subject.needs = SceneNeeds::of(&lit_screen(gloss));
    (subject, world)
}

/// Returns images of an eye's view: hits and guides.
fn seen(world: &World, constants: &Constants, eye: &Eye) -> (Vec<[u32; 4]>, Vec<[u32; 4]>) {
    let pixel = |i: u32| {
        let direction = eye.ray(constants.through(i % WIDTH, i / WIDTH), constants.size());
        let Some(met) = world.meets(eye.origin.as_dvec3(), direction, 0.0) else {
            return ([u32::MAX, 0, 0, 0], [0, 0, 0, NO_NORMAL]);
        };
        let [u, v] = met.weights.map(|w| (w as f32).to_bits());
        let normal = world.normal_towards(met.triangle, direction);
        ([met.triangle as u32, u, v, 0], pack_guide(met.position, normal))
    };
    (0..WIDTH * HEIGHT).map(pixel).unzip()
}

/// Returns settings of one path for each pixel.
fn sampling(index: u32, reflections: u32) -> Sampling {
    let samples = PixelSamples { least: 1, ..Default::default() };
    Sampling { index, reflections, samples, sampled_fraction: 1.0, ..Default::default() }
}

fn with_samples(mut sampling: Sampling, change: impl FnOnce(&mut PixelSamples)) -> Sampling {
    change(&mut sampling.samples);
    sampling
}

/// Computes the gradients of a frame whose settings all differ from those of the previous frame.
fn gradients(
    subject: &Subject,
    format: Format,
    (constants, history): (&Constants, History),
    previous: Previous,
    stripe: &Stripe,
    (images, probes): ([&[[u32; 4]]; 4], &[f32]),
) -> Vec<[f32; 2]> {
    let samples = PixelSamples { least: 4, first: 3, curve_shift: 2, ..Default::default() };
    let own = Sampling { seed: 77, samples, ..sampling(constants.index, 5) };
    run(subject, format, (constants, history), own, previous, stripe, (images, probes), "gradient")
}

/// Runs the kernel in a frame with the settings `own`, whose own images are those of the previous frame. Returns the
/// image `output`: gradients or probes.
#[allow(clippy::too_many_arguments)]
fn run<T: bytemuck::Pod>(
    subject: &Subject,
    format: Format,
    (constants, history): (&Constants, History),
    own: Sampling,
    previous: Previous,
    stripe: &Stripe,
    ([last_surface, hit, guide, radiance], probes): ([&[[u32; 4]]; 4], &[f32]),
    output: &str,
) -> Vec<T> {
    let mut frame = Frame { history, sampling: own, ..constants.frame() };
    subject.tables.describe(&mut frame);
    let [width, height] = TILES;
    let pass = PassConstants { width, height, ..stripe.pass(0, [WIDTH, HEIGHT, u32::from(output == "probe")]) };
    let before = vec![[f32::NAN; 2]; (width * height) as usize];
    let buffers = [
        ("last_surface", Buffer::whole(last_surface)),
        ("last_hit", Buffer::whole(hit)),
        ("last_guide", Buffer::whole(guide)),
        ("last_radiance", Buffer::whole(radiance)),
        ("hit_image", Buffer::whole(hit)),
        ("guide_image", Buffer::whole(guide)),
        ("last_probe", Buffer::whole(probes)),
        ("probe", Buffer::image(&vec![f32::NAN; before.len()])),
        ("gradient", Buffer::image(&before)),
        ("previous", Buffer::whole(&[previous])),
    ];
    let overrides = [("SOBOL", true), ("HAS_GLOSS", format.gloss), ("HAS_MOTION", true)];
    let outputs = Kernel::with_scene("gradient", &overrides, subject).run_frame(&frame, pass, [1, 1], &buffers);
    outputs.get(output)
}

/// Damages a pixel of the previous frame: its surface may be gone, may not be sampled, or may be a lamp.
fn damaged(random: &mut Random, hit: &mut [u32; 4], guide: &mut [u32; 4], radiance: &mut [u32; 4]) {
    match random.bits() % 20 {
        0 => *guide = [0, 0, 0, NO_NORMAL],
        1 => guide[3] = pack_guide(DVec3::ZERO, DVec3::new(0.9, 0.1, 0.2).normalize())[3],
        2 => guide[2] = (f32::from_bits(guide[2]) + 0.4).to_bits(),
        3..6 => *radiance = [0; 4],
        6 => hit[0] = SPHERE,
        _ => {}
    }
}

struct Case {
    gloss: bool,
    /// Translation and upward rotation of the eye since the previous frame.
    step: (DVec3, f64),
    is_jittered: bool,
    history_rows: Option<u32>,
    lost: Range<u32>,
    /// True if unavailable rows hold correct data instead of values that are not finite.
    tempts: bool,
    seed: u64,
}

fn compare(case: &Case, cases: &mut Cases) {
    let (subject, world) = subject(screen(), case.gloss);
    let mut random = Random::new(case.seed);
    let mut constants = Constants { index: 40 + case.seed as u32, ..Constants::new(WIDTH, HEIGHT) };
    constants.history_rows = case.history_rows;
    let format = Format { gloss: case.gloss };
    let eye = constants.eyes[0].moved(case.step.0, 0.01, case.step.1);
    let previous = Constants { eyes: [eye; 2], ..constants.clone() };
    let views = previous.frame().camera.views;
    let settings = with_samples(sampling(7, 1), |samples| samples.is_jittered = case.is_jittered.into());
    let mut unclear = 0;
    let inside = [(0..7, 0..7), (2..5, 1..6), (3..4, 3..4), (4..7, 3..7), (0..2, 0..3)];
    for stripe in inside.map(|(rows, valid)| Stripe { rows, valid }) {
        let (_, mut last_surface) = seen(&world, &constants, &constants.eyes[0]);
        last_surface.iter_mut().filter(|_| random.chance(0.05)).for_each(|bits| bits[3] = NO_NORMAL);
        let (mut hit, mut guide) = seen(&world, &constants, &eye);
        let light = luminance(world.strength) / PI;
        let mut radiance: Vec<_> = (0..constants.area())
            .map(|_| {
                let light = Light { matte: random.color(1.5 * light), ..random.light(0.1) };
                match random.bits() % 4 {
                    0 => format.pack_sampled(&Light::default()),
                    _ if case.is_jittered => format.pack_sampled_with(&light),
                    _ => format.pack_sampled(&light),
                }
            })
            .collect();
        for ((hit, guide), radiance) in hit.iter_mut().zip(&mut guide).zip(&mut radiance) {
            damaged(&mut random, hit, guide, radiance);
        }
        let probes: Vec<f32> = (0..TILES[0] * TILES[1])
            .map(|_| if random.chance(0.2) { -1.0 } else { (light * f64::from(random.bits()) * 2f64.powi(-32)) as f32 })
            .collect();
        let before = Before {
            eye,
            probes: case.is_jittered.then(|| (settings.index, probes.clone())),
            guide: guide.iter().map(|bits| Surface::unpack(*bits)).collect(),
            hit: hit.clone(),
            then: radiance.iter().map(|bits| Some(format.unpack_sampled(*bits)?.luminances().element_sum())).collect(),
        };
        let rows = |tiles: &Range<u32>| tiles.start * TILE..(tiles.end * TILE).min(HEIGHT);
        let own = only_in(&rows(&stripe.rows), WIDTH, &last_surface);
        let readable = if case.tempts { 0..HEIGHT } else { rows(&stripe.valid) };
        let [hit, guide, radiance] = [&hit, &guide, &radiance].map(|image| only_in(&readable, WIDTH, image));
        let found = gradients(
            &subject,
            format,
            (&constants, History::new(case.history_rows, case.lost.clone())),
            Previous { views, sampling: settings },
            &stripe,
            ([&own, &hit, &guide, &radiance], &probes),
        );
        let last_surface: Vec<_> = last_surface.iter().map(|bits| Surface::unpack(*bits)).collect();
        let lost = case.lost.clone();
        let (world, constants, last_surface, before) = (&world, &constants, &last_surface[..], &before);
        let twin = Twin { world, constants, stripe: &stripe, lost, last_surface, before };
        for (x, y) in stripe.pixels(TILES[0]) {
            let got = found[(y * TILES[0] + x) as usize].map(f64::from);
            let Some(want) = twin.tile((x, y), cases) else {
                unclear += 1;
                continue;
            };
            // Specular and diffuse radiance are stored as half floats.
            let allowed = (1e-4 + if case.gloss { HALF } else { 0.0 }) * want.y;
            let off = (got[0] - want.x).abs().max((got[1] - want.y).abs());
            assert!(off <= allowed, "{got:?} instead of {want} at ({x}, {y}) of {stripe:?}");
        }
    }
    assert!(unclear < 20, "{unclear} tiles are left to rounding");
}

const WITH_HISTORY: [&str; 9] = [
    "no surface",
    "another surface",
    "not sampled",
    "a lamp",
    "rows that are not there",
    "dark as before",
    "dark",
    "lit",
    "lit as well",
];

#[test]
fn gradient_is_the_change_of_light_on_a_surface() {
    for (gloss, tempts, seed) in [(false, false, 141), (true, false, 142), (false, true, 143), (true, true, 144)] {
        let mut cases = Cases::default();
        let step = (DVec3::new(0.05, -0.04, 0.03), 0.12);
        let case = Case { gloss, step, is_jittered: false, history_rows: Some(6), lost: 0..0, tempts, seed };
        (0..3).for_each(|i| compare(&Case { seed: 10 * seed + i, lost: 0..0, ..case }, &mut cases));
        cases.assert_met(&WITH_HISTORY);
        cases.assert_met(&["outside the image"]);
    }
}

#[test]
fn lost_or_distant_rows_have_no_gradients() {
    let mut cases = Cases::default();
    let step = (DVec3::new(0.0, 0.02, 0.0), -0.12);
    let case =
        Case { gloss: false, step, is_jittered: false, history_rows: Some(2), lost: 8..12, tempts: true, seed: 151 };
    compare(&case, &mut cases);
    cases.assert_met(&["lost rows", "beyond the reach", "lit as well"]);
    compare(&Case { step: (DVec3::Z * -9.0, 0.0), history_rows: Some(8), lost: 0..0, ..case }, &mut cases);
    cases.assert_met(&["behind the eye"]);
}

#[test]
fn frames_without_history_have_no_gradients() {
    let mut cases = Cases::default();
    let step = (DVec3::ZERO, 0.0);
    let case = Case { gloss: false, step, is_jittered: false, history_rows: None, lost: 0..0, tempts: true, seed: 161 };
    compare(&case, &mut cases);
    cases.assert_met(&["no history"]);
}

#[test]
fn multi_sample_frames_compare_their_probes() {
    for (gloss, tempts, seed) in [(false, false, 171), (true, true, 172)] {
        let mut cases = Cases::default();
        let step = (DVec3::new(0.05, -0.04, 0.03), 0.12);
        let case = Case { gloss, step, is_jittered: true, history_rows: Some(2), lost: 8..10, tempts, seed };
        (0..4).for_each(|i| compare(&Case { seed: 10 * seed + i, lost: 8..10, ..case }, &mut cases));
        cases.assert_met(&["no probe", "a probe beyond the reach", "lost rows", "another surface", "lit as well"]);
    }
}

/// Returns the radiance image of paths with these settings.
fn traced(
    subject: &Subject,
    format: Format,
    constants: &Constants,
    sampling: Sampling,
    [hit, guide]: [&[[u32; 4]]; 2],
) -> Vec<[u32; 4]> {
    let mut frame = Frame { sampling, ..constants.frame() };
    subject.tables.describe(&mut frame);
    let whole = Stripe { rows: 0..HEIGHT, valid: 0..HEIGHT };
    let pass = PassConstants { width: WIDTH, height: HEIGHT, ..whole.pass(0, [0, 1, 0]) };
    let nothing = vec![[0u32; 4]; constants.area()];
    let buffers = [
        ("hit_image", Buffer::image(hit)),
        ("albedo_image", Buffer::image(&nothing)),
        ("emission_image", Buffer::image(&nothing)),
        ("radiance_image", Buffer::image(&nothing)),
        ("tally_image", Buffer::image(&vec![0u32; constants.area()])),
        ("guide_image", Buffer::whole(guide)),
        ("holes", Buffer::whole(&[0u32; 4])),
        ("last_cache", Buffer::whole(&[[0u32; 4]; 2])),
        ("records", Buffer::image(&nothing)),
    ];
    let overrides = [("SOBOL", true), ("HAS_GLOSS", format.gloss)];
    let outputs = Kernel::with_scene("path_trace", &overrides, subject).run_rows(&frame, pass, &buffers);
    outputs.get("radiance_image")
}

/// Returns the gradients after a frame of several samples per pixel. The sun is `factor` times as strong as in that
/// frame. The eyes do not move.
fn after_probes(gloss: bool, settings: Sampling, factor: f32) -> Vec<[f32; 2]> {
    let (subject_before, world) = subject(lit_screen(gloss), gloss);
    let constants = Constants { history_rows: Some(0), index: 9, ..Constants::new(WIDTH, HEIGHT) };
    let format = Format { gloss };
    let (hit, guide) = seen(&world, &constants, &constants.eyes[0]);
    let views = constants.frame().camera.views;
    let whole = Stripe { rows: 0..TILES[1], valid: 0..TILES[1] };
    let nothing = vec![[0u32; 4]; constants.area()];
    let images = [&guide[..], &hit, &guide, &nothing];
    let none = vec![-1.0; (TILES[0] * TILES[1]) as usize];
    let before = (&constants, History::new(None, 0..0));
    let previous = Previous { views, sampling: settings };
    let probes: Vec<f32> = run(&subject_before, format, before, settings, previous, &whole, (images, &none), "probe");
    let mut scene = lit_screen(gloss);
    scene.lights[0].strength *= factor;
    let now = (&constants, History::new(Some(0), 0..0));
    gradients(&subject(scene, gloss).0, format, now, previous, &whole, (images, &probes))
}

#[test]
fn probes_detect_only_changed_light() {
    for gloss in [false, true] {
        let two = PixelSamples { is_jittered: 1, least: 2, curve_shift: 1, ..Default::default() };
        let settings = Sampling { samples: two, ..sampling(8, 3) };
        let between = PixelSamples { is_jittered: 0, least: 1, extra: 0.5, ..two };
        let between = Sampling { samples: between, ..settings };
        for settings in [settings, between] {
            let still = after_probes(gloss, settings, 1.0);
            assert_same(&still, gloss);
            assert!(still.iter().filter(|[_, light]| *light > 0.1).count() > 5, "{still:?}");
            let brighter = after_probes(gloss, settings, 3.0);
            assert!(brighter.iter().filter(|[change, light]| *change > 0.3 * light).count() > 3, "{brighter:?}");
        }
        let one = Sampling { samples: PixelSamples { is_jittered: 0, least: 1, ..two }, ..settings };
        assert!(after_probes(gloss, one, 3.0).iter().all(|v| *v == [0.0; 2]), "frames of one sample have no probes");
    }
}

/// Returns the gradients after a frame that was traced with `settings`, if the previous settings are given as `said`.
/// The eyes do not move.
fn after(scene: Scene, gloss: bool, settings: Sampling, said: &[Sampling]) -> Vec<Vec<[f32; 2]>> {
    let (subject, world) = subject(scene, gloss);
    let constants = Constants { history_rows: Some(0), index: 9, ..Constants::new(WIDTH, HEIGHT) };
    let format = Format { gloss };
    let (hit, guide) = seen(&world, &constants, &constants.eyes[0]);
    let radiance = traced(&subject, format, &constants, settings, [&hit, &guide]);
    let views = constants.frame().camera.views;
    let whole = Stripe { rows: 0..TILES[1], valid: 0..TILES[1] };
    let none = vec![-1.0; (TILES[0] * TILES[1]) as usize];
    let gradients = |sampling: &Sampling| {
        let (previous, images) = (Previous { views, sampling: *sampling }, [&guide, &hit, &guide, &radiance]);
        let history = History::new(Some(0), 0..0);
        gradients(&subject, format, (&constants, history), previous, &whole, (images.map(Vec::as_slice), &none))
    };
    said.iter().map(gradients).collect()
}

/// Asserts that light has not changed, within rounding: of sums, and of half floats with specular radiance.
#[track_caller]
fn assert_same(found: &[[f32; 2]], gloss: bool) {
    let allowed = if gloss { HALF as f32 } else { 1e-6 };
    assert!(found.iter().all(|[change, light]| change.abs() <= allowed * light), "{found:?}");
}

#[test]
fn constant_sunlight_has_no_gradients() {
    for gloss in [false, true] {
        let settings = sampling(5, 1);
        let found = after(screen(), gloss, settings, &[settings]).remove(0);
        assert_same(&found, gloss);
        assert!(found.iter().filter(|[_, light]| *light > 0.1).count() > 20, "{found:?}");
    }
}

#[test]
fn dropped_samples_have_no_gradients() {
    for gloss in [false, true] {
        let settings = sampling(5, 1);
        let found = after(dazzled(), gloss, settings, &[settings]).remove(0);
        assert_same(&found, gloss);
        let [dark, bright] = [false, true].map(|b| found.iter().filter(|[_, light]| (*light > 1e3) == b).count());
        assert!(dark > 5 && bright > 5, "{dark} tiles are dark, and {bright} are bright: {found:?}");
    }
}

/// Gradients repeat the previous frame's paths of several bounces under all kinds of lamps, whatever this frame's
/// settings are.
#[test]
fn gradients_repeat_paths_of_the_previous_frame() {
    for gloss in [false, true] {
        let settings = Sampling { seed: 3, indirect_clamp: 0.05, ..sampling(5, 3) };
        let settings = with_samples(settings, |samples| samples.first = 1);
        let others = [
            Sampling { index: 6, ..settings },
            Sampling { seed: 4, ..settings },
            with_samples(settings, |samples| samples.first = 2),
            with_samples(settings, |samples| samples.curve_shift = 1),
            with_samples(settings, |samples| samples.curve_shift = NO_CURVE),
            Sampling { reflections: 2, ..settings },
            Sampling { indirect_clamp: 0.0, ..settings },
        ];
        let same = with_samples(settings, |samples| samples.is_jittered = 1);
        let all: Vec<_> = [settings, same].into_iter().chain(others).collect();
        let found = after(lit_screen(gloss), gloss, settings, &all);
        let changed = |found: &[[f32; 2]]| found.iter().filter(|[change, light]| change.abs() > 1e-3 * light).count();
        assert_eq!(changed(&found[0]), 0, "{:?}", found[0]);
        assert!(found[0].iter().filter(|[_, light]| *light > 0.1).count() > 30, "{:?}", found[0]);
        assert!(found[1].as_flattened().iter().all(|v| *v == 0.0), "without probes: {:?}", found[1]);
        for (found, other) in found[2..].iter().zip(others) {
            assert!(changed(found) > 2, "{} tiles changed with {other:?}", changed(found));
        }
    }
}
