//! Temporal gradients.

mod scenes;
mod twin;

use std::f64::consts::PI;
use std::ops::Range;

use diptych::accel::SPHERE;
use diptych::layout::{Frame, History, PassConstants, Previous, Sampling};
use diptych::samples::{NO_CURVE, PixelSamples};
use diptych::scene::Scene;
use glam::DVec3;

use self::scenes::{dazzled, lit_screen, screen, subject};
use self::twin::{Before, TILE, Twin, World};
use super::camera::{Constants, Eye};
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Stripe, only_in};
use super::inputs::{Cases, HEIGHT, Random, WIDTH};
use super::pack::{Format, HALF, Light, NO_NORMAL, luminance, pack_guide};
use crate::common::Subject;

/// Columns and rows of tiles.
const TILES: [u32; 2] = [WIDTH.div_ceil(TILE), HEIGHT.div_ceil(TILE)];

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

/// What a frame knows of the previous one beside its hits and guides.
struct Past<'a> {
    history: History,
    previous: Previous,
    last_surface: &'a [[u32; 4]],
    radiance: &'a [[u32; 4]],
    probes: &'a [f32],
}

/// Frames with the same hits and guides.
struct Frames {
    subject: Subject,
    format: Format,
    constants: Constants,
    hit: Vec<[u32; 4]>,
    guide: Vec<[u32; 4]>,
}

/// All tiles.
const WHOLE: Stripe = Stripe { rows: 0..TILES[1], valid: 0..TILES[1] };
const NO_PROBES: [f32; (TILES[0] * TILES[1]) as usize] = [-1.0; (TILES[0] * TILES[1]) as usize];

impl Frames {
    /// Creates frames of eyes that do not move.
    fn still(scene: Scene, gloss: bool) -> Self {
        let (subject, world) = subject(scene, gloss);
        let constants = Constants { history_rows: Some(0), index: 9, ..Constants::new(WIDTH, HEIGHT) };
        let (hit, guide) = seen(&world, &constants, &constants.eyes[0]);
        Self { subject, format: Format { gloss }, constants, hit, guide }
    }

    fn past<'a>(&'a self, sampling: Sampling, radiance: &'a [[u32; 4]], probes: &'a [f32]) -> Past<'a> {
        let previous = Previous { views: self.constants.frame().camera.views, sampling };
        Past { history: History::new(Some(0), 0..0), previous, last_surface: &self.guide, radiance, probes }
    }

    /// Computes gradients with settings that all differ from those of the previous frame.
    fn gradients(&self, past: &Past<'_>, stripe: &Stripe) -> Vec<[f32; 2]> {
        let samples = PixelSamples { least: 4, first: 3, curve_shift: 2, ..Default::default() };
        self.run(Sampling { seed: 77, samples, ..sampling(self.constants.index, 5) }, past, stripe, "gradient")
    }

    /// Runs the kernel with the settings `own`. Returns the image `output`: gradients or probes.
    fn run<T: bytemuck::Pod>(&self, own: Sampling, past: &Past<'_>, stripe: &Stripe, output: &str) -> Vec<T> {
        let mut frame = Frame { history: past.history, sampling: own, ..self.constants.frame() };
        self.subject.tables.describe(&mut frame);
        let [width, height] = TILES;
        let pass = PassConstants { width, height, ..stripe.pass(0, [WIDTH, HEIGHT, u32::from(output == "probe")]) };
        let buffers = [
            ("last_surface", Buffer::whole(past.last_surface)),
            ("last_hit", Buffer::whole(&self.hit)),
            ("last_guide", Buffer::whole(&self.guide)),
            ("last_radiance", Buffer::whole(past.radiance)),
            ("hit_image", Buffer::whole(&self.hit)),
            ("guide_image", Buffer::whole(&self.guide)),
            ("last_probe", Buffer::whole(past.probes)),
            ("probe", Buffer::image(&NO_PROBES.map(|_| f32::NAN))),
            ("gradient", Buffer::image(&NO_PROBES.map(|_| [f32::NAN; 2]))),
            ("previous", Buffer::whole(&[past.previous])),
        ];
        let overrides = [("SOBOL", true), ("HAS_GLOSS", self.format.gloss), ("HAS_MOTION", true)];
        let kernel = Kernel::with_scene("gradient", &overrides, &self.subject);
        kernel.run_rows(&frame, pass, &buffers).get(output)
    }

    /// Returns the radiance image of paths with these settings.
    fn traced(&self, sampling: Sampling) -> Vec<[u32; 4]> {
        let mut frame = Frame { sampling, ..self.constants.frame() };
        self.subject.tables.describe(&mut frame);
        let whole = Stripe { rows: 0..HEIGHT, valid: 0..HEIGHT };
        let pass = PassConstants { width: WIDTH, height: HEIGHT, ..whole.pass(0, [0, 1, 0]) };
        let nothing = vec![[0u32; 4]; self.constants.area()];
        let buffers = [
            ("hit_image", Buffer::image(&self.hit)),
            ("albedo_image", Buffer::image(&nothing)),
            ("emission_image", Buffer::image(&nothing)),
            ("radiance_image", Buffer::image(&nothing)),
            ("tally_image", Buffer::image(&vec![0u32; self.constants.area()])),
            ("guide_image", Buffer::whole(&self.guide)),
            ("listed", Buffer::whole(&[0u32; 4])),
            ("last_cache", Buffer::whole(&[[0u32; 4]; 2])),
            ("records", Buffer::image(&nothing)),
        ];
        let kernel =
            Kernel::with_scene("path_trace", &[("SOBOL", true), ("HAS_GLOSS", self.format.gloss)], &self.subject);
        kernel.run_rows(&frame, pass, &buffers).get("radiance_image")
    }
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
    let (hit, guide) = (Vec::new(), Vec::new());
    let mut frames = Frames { subject, format, constants: constants.clone(), hit, guide };
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
        let past = Past {
            history: History::new(case.history_rows, case.lost.clone()),
            previous: Previous { views, sampling: settings },
            last_surface: &own,
            radiance: &radiance,
            probes: &probes,
        };
        (frames.hit, frames.guide) = (hit, guide);
        let found = frames.gradients(&past, &stripe);
        let last_surface: Vec<_> = last_surface.iter().map(|bits| Surface::unpack(*bits)).collect();
        let (lost, last_surface, before) = (case.lost.clone(), &last_surface[..], &before);
        let twin = Twin { world: &world, constants: &constants, stripe: &stripe, lost, last_surface, before };
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

/// Returns the gradients after a frame of several samples per pixel. The sun is `factor` times as strong as in that
/// frame.
fn after_probes(gloss: bool, settings: Sampling, factor: f32) -> Vec<[f32; 2]> {
    let mut frames = Frames::still(lit_screen(gloss), gloss);
    let nothing = vec![[0u32; 4]; frames.constants.area()];
    let past = Past { history: History::new(None, 0..0), ..frames.past(settings, &nothing, &NO_PROBES) };
    let probes: Vec<f32> = frames.run(settings, &past, &WHOLE, "probe");
    let mut scene = lit_screen(gloss);
    scene.lights[0].strength *= factor;
    frames.subject = subject(scene, gloss).0;
    frames.gradients(&frames.past(settings, &nothing, &probes), &WHOLE)
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
fn after(scene: Scene, gloss: bool, settings: Sampling, said: &[Sampling]) -> Vec<Vec<[f32; 2]>> {
    let frames = Frames::still(scene, gloss);
    let radiance = frames.traced(settings);
    said.iter().map(|said| frames.gradients(&frames.past(*said, &radiance, &NO_PROBES), &WHOLE)).collect()
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
