//! Temporal accumulation before and after the fit.

use glam::{DVec2, DVec3, Vec2};

use super::camera::{Constants, Eye};
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{
    Counts, Format, Light, MATERIAL_MASK, MIRRORED, MeanLight, SAMPLED, VIEW_DEPENDENT, blended, is_finite,
};

/// Half floats that are not finite. As floats they are not finite either.
const INFINITE: [u32; 4] = [0x7f80_7c00; 4];

/// Minimum weights of a new frame.
const SHARES: [f32; 2] = [0.2, 0.1];

/// Materials of surfaces, some of which are seen in mirrors.
const MATERIALS: [u32; 6] = [7, 7, 7, 8, 7 | MIRRORED, 7 | MIRRORED];

/// Guides and accumulated light of the previous frame.
struct Before {
    eye: Eye,
    format: Format,
    guide: Vec<[u32; 4]>,
    light: Vec<[u32; 4]>,
}

impl Before {
    fn new(random: &mut Random, constants: &Constants, format: Format, view: usize, eye: Eye) -> Self {
        let mut seen_by = constants.clone();
        seen_by.eyes[view] = eye;
        // The right eye lacks history in many pixels, so that the left eye's is used.
        let lost = if view == 1 { 0.6 } else { 0.15 };
        let light = |random: &mut Random| {
            let light = random.light(1.0);
            let [x, y, z, _] = match random.chance(0.02) {
                true => INFINITE,
                false => format.pack(&random.with_absent(light)),
            };
            let frames = if random.chance(lost) { 0 } else { random.pick(&[1, 2, 3, 4, 9, 30, 255]) };
            [x, y, z, random.pick(&MATERIALS) | frames << 24]
        };
        let guide = Wall::new(0.003, 0.3, 0.05).guides(random, &seen_by, view);
        Self { eye, format, guide, light: (0..constants.area()).map(|_| light(random)).collect() }
    }

    /// Returns light, frames and sum of weights of the pixels around the previous image point of `image`, where a surface
    /// or its mirror image is.
    fn past(
        &self,
        (constants, stripe): (&Constants, &Stripe),
        row: u32,
        (surface, image): (&Surface, DVec3),
        material: u32,
        lobes: DVec2,
    ) -> Past {
        let (mut matte, mut gloss) = (MeanLight::default(), MeanLight::default());
        let (mut frames, mut found) = (0.0, 0.0);
        if let Some((seen, z)) = self.eye.seen_at(image, constants.size()) {
            let corner = seen - constants.centre.as_dvec2();
            let (base, fraction) = (corner.floor(), corner - corner.floor());
            let reach = constants.history_rows.expect("there is history");
            let rows = stripe.valid.start.max(row.saturating_sub(reach))..stripe.valid.end.min(row + reach + 1);
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let offset = ((base.x as i32).saturating_add(dx), (base.y as i32).saturating_add(dy));
                let Some(tap) = constants.tap((0, 0), offset, &rows) else { continue };
                let Some(then) = Surface::unpack(self.guide[tap]) else { continue };
                let word = self.light[tap][3];
                let light = self.format.light(self.light[tap]);
                let is_same = word & MATERIAL_MASK == material
                    && word >> 24 != 0
                    && surface.normal.dot(then.position - surface.position).abs() < 0.005 * z
                    && surface.normal.dot(then.normal) > 0.9;
                // Surfaces without a lobe are no history of one with it.
                if is_same && light.lobes().cmpge(lobes).all() {
                    let share = |d: i32, fraction: f64| if d == 0 { 1.0 - fraction } else { fraction };
                    let w = share(dx, fraction.x) * share(dy, fraction.y);
                    matte.add(light.matte, w);
                    gloss.add(light.gloss, w);
                    frames += f64::from(word >> 24) * w;
                    found += w;
                }
            }
        }
        let is_finite = matte.is_finite() && gloss.is_finite();
        let light = Light { matte: matte.above(0.01), gloss: gloss.above(0.01), ..Light::default() };
        Past { light, is_finite, frames, found }
    }
}

/// History of a pixel: its mean light, and sums of frames and weights.
struct Past {
    light: Light,
    is_finite: bool,
    frames: f64,
    found: f64,
}

impl Format {
    /// Unpacks light whose last word is something else.
    fn light(&self, [x, y, z, _]: [u32; 4]) -> Light {
        self.unpack([x, y, z, 0])
    }
}

fn is_sound(light: &Light) -> bool {
    is_finite(light.matte) && is_finite(light.gloss)
}

/// Expected result of a pixel: light, frames before rounding, and whether something was dropped.
struct After {
    light: Light,
    frames: f64,
    dropped: bool,
}

#[derive(Clone, Copy)]
struct Case {
    gloss: bool,
    view: usize,
    has_history: bool,
    least_fraction: f32,
    seed: u64,
}

fn twin(case: Case, pasts: &[Past], now: Option<Light>, cases: &mut Cases) -> After {
    let mut dropped = now.is_some_and(|light| !is_sound(&light));
    let now = now.filter(is_sound);
    cases.meet(if dropped { "light that is not finite" } else { "light" });
    let mut history = None;
    for (i, past) in pasts.iter().enumerate() {
        if !past.is_finite {
            cases.meet("history that is not finite");
            dropped = true;
        } else if past.found >= 0.01 {
            cases.meet(if i == 0 { "own history" } else { "the left eye's history" });
            history = Some((past.light, past.frames / past.found));
            break;
        }
    }
    let (light, frames) = match (history, now) {
        (None, None) => {
            cases.meet("nothing");
            (Light::default(), 0.0)
        }
        (None, Some(now)) => (now, 1.0),
        (Some((light, frames)), None) => {
            cases.meet("history alone");
            (light, frames)
        }
        (Some((light, frames)), Some(now)) => {
            let least = f64::from(case.least_fraction);
            cases.meet(if 1.0 / (frames + 1.0) < least { "exponential mean" } else { "mean" });
            let fraction = (1.0 / (frames + 1.0)).max(least);
            let [matte, gloss] = [|light: &Light| light.matte, |light: &Light| light.gloss]
                .map(|lobe| blended(lobe(&light), lobe(&now), fraction));
            (Light { matte, gloss, ..light }, frames + 1.0)
        }
    };
    After { light, frames: frames.min(255.0), dropped }
}

fn compare(case: Case, cases: &mut Cases) {
    let mut random = Random::new(case.seed);
    let mut constants = Constants { centre: Vec2::new(0.3, 0.8), ..Constants::new(WIDTH, HEIGHT) };
    constants.history_rows = case.has_history.then_some(1);
    let format = Format { gloss: case.gloss };
    let eyes = constants.eyes.map(|eye| eye.moved(DVec3::new(0.07, -0.05, 0.02), -0.02, -0.06));
    let previous = Constants { eyes, ..constants.clone() }.as_previous();
    let overrides = [("HAS_GLOSS", case.gloss), ("MARKS_ABSENT", true), ("HAS_MIRRORS", true)];
    for stripe in stripes() {
        let guide = Wall::new(0.002, 0.2, 0.15).guides(&mut random, &constants, case.view);
        let before = [0, case.view].map(|view| Before::new(&mut random, &constants, format, view, eyes[view]));
        let mut hit = || {
            let length = random.within(4.0..5.0) as f32;
            [1, length.to_bits(), 3, random.pick(&MATERIALS) | VIEW_DEPENDENT]
        };
        let hit: Vec<_> = (0..constants.area()).map(|_| hit()).collect();
        let source: Vec<[u32; 4]> = (0..constants.area())
            .map(|_| match random.bits() % 20 {
                0 => [INFINITE[0], INFINITE[1], INFINITE[2], SAMPLED],
                1..6 => [0; 4],
                _ => {
                    let light = random.light(1.5);
                    format.pack_sampled(&random.with_absent(light))
                }
            })
            .collect();
        let tally: Vec<u32> = (0..constants.area()).map(|_| random.bits()).collect();
        let words = random.rubbish::<4>(constants.area());
        let valid = |pixels: &[[u32; 4]]| stripe.valid(WIDTH, pixels);
        let buffers = [
            ("hit_image", stripe.own(WIDTH, &hit)),
            ("guide_image", stripe.own(WIDTH, &guide)),
            ("source", stripe.own(WIDTH, &source)),
            ("last_guide", valid(&before[1].guide)),
            ("last_accumulated", valid(&before[1].light)),
            ("left_guide", valid(&before[0].guide)),
            ("left_accumulated", valid(&before[0].light)),
            ("accumulated", Buffer::image(&words)),
            ("previous", Buffer::whole(&previous)),
            ("tally_image", Buffer::image(&tally)),
            ("light_change", Buffer::whole(&[0.0f32])),
        ];
        let pass = stripe.pass(case.view, [case.least_fraction.to_bits(), 0, 0]);
        let outputs = Kernel::new("bmfr_accumulate", &overrides).run(&constants, pass, WIDTH, &buffers);
        let (got, counted) = (outputs.get::<[u32; 4]>("accumulated"), outputs.get::<u32>("tally_image"));
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let (material, place) = (hit[at][3] & MATERIAL_MASK, format!("({x}, {y}) of {stripe:?}"));
            let Some(surface) = Surface::unpack(guide[at]) else {
                let [x, y, z, told] = source[at];
                let is_damaged = [x, y, z] == INFINITE[..3];
                cases.meet(match (told, is_damaged) {
                    (0, _) => "no surface and no light",
                    (_, true) => "no surface and light that is not finite",
                    (_, false) => "no surface",
                });
                let light = if is_damaged { [0; 3] } else { [x, y, z] };
                assert_eq!(got[at], [light[0], light[1], light[2], material], "{place}");
                let counts = Counts::unpack(tally[at]).with_dropped(u32::from(is_damaged));
                assert_eq!(Counts::unpack(counted[at]), counts, "{place}");
                continue;
            };
            let known: &[&Before] = match (case.has_history, case.view) {
                (false, _) => &[],
                (true, 0) => &[&before[1]],
                (true, _) => &[&before[1], &before[0]],
            };
            let eye = &constants.eyes[case.view];
            let ray = eye.ray(constants.through(x, y), constants.size());
            let mirrored = eye.origin.as_dvec3() + ray * f64::from(f32::from_bits(hit[at][1]));
            let image = if material & MIRRORED != 0 { mirrored } else { surface.position };
            let now = (source[at][3] != 0).then(|| format.light(source[at]));
            let lobes = now.filter(is_sound).map_or(DVec2::ZERO, |light| light.lobes());
            let past = |b: &&Before| b.past((&constants, &stripe), y, (&surface, image), material, lobes);
            let pasts: Vec<_> = known.iter().map(past).collect();
            if known.iter().zip(&pasts).any(|(_, past)| past.found >= 0.01) {
                cases.meet(if material & MIRRORED != 0 { "history in a mirror" } else { "history outside" });
            }
            if lobes.min_element() == 0.0 {
                cases.meet("an absent lobe");
            }
            let want = twin(case, &pasts, now, cases);
            let light = format.light(got[at]);
            // Weights of pixels have errors of about 1e-6 and are divided by their sum, which is at least 0.01.
            let holds = format.holds([got[at][0], got[at][1], got[at][2], 0], &want.light, 5e-4, 1e-4);
            assert!(holds, "{place}: {light:?}, {:?}", want.light);
            let frames = f64::from(got[at][3] >> 24);
            assert!((frames - want.frames).abs() <= 0.5 + 5e-4 * want.frames, "{place}: {frames}, {}", want.frames);
            assert_eq!(got[at][3] & MATERIAL_MASK, material, "{place}");
            let counts = Counts::unpack(tally[at]).with_dropped(u32::from(want.dropped));
            assert_eq!(Counts::unpack(counted[at]), counts, "{place}");
        }
    }
}

fn hold(case: Case, met: &[&'static str]) {
    let mut cases = Cases::default();
    compare(case, &mut cases);
    cases.assert_met(met);
}

const CASE: Case = Case { gloss: false, view: 1, has_history: true, least_fraction: 0.2, seed: 0 };

#[test]
fn bmfr_starts_history_with_the_first_frame() {
    let met = ["no surface", "light", "light that is not finite", "nothing"];
    let met = [&met[..], &["no surface and no light", "no surface and light that is not finite"]].concat();
    hold(Case { has_history: false, seed: 411, ..CASE }, &met);
}

#[test]
fn bmfr_mean_becomes_exponential_after_many_frames() {
    let met = ["mean", "exponential mean", "own history", "history alone", "history that is not finite"];
    let met = [&met[..], &["history in a mirror", "history outside"]].concat();
    for (least_fraction, seed) in SHARES.into_iter().zip(412..) {
        hold(Case { view: 0, least_fraction, seed, ..CASE }, &met);
    }
}

#[test]
fn bmfr_falls_back_to_left_eye_history() {
    for (gloss, seed) in [(false, 414), (true, 415)] {
        hold(Case { gloss, seed, ..CASE }, &["own history", "the left eye's history", "nothing", "an absent lobe"]);
    }
}
