//! Temporal accumulation of light.

mod moments;
mod twin;

use glam::{DVec2, DVec3, Vec2};

use self::moments::Moments;
use self::twin::{After, Before, Now, Twin};
use super::camera::{Constants, Eye};
use super::edges::Surface;
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{
    ABSENT, Counts, Format, HALF, HALF_STEP, Light, MATERIAL_MASK, MIRRORED, MISSING, SAMPLED, UNKNOWN, VIEW_DEPENDENT,
    is_near,
};

/// Motion of the eyes since the previous frame.
#[derive(Clone, Copy)]
enum Motion {
    /// No previous frame.
    None,
    Still,
    /// Motion by some thousandths of a pixel.
    Slow,
    /// Motion by some pixels.
    Moved,
    /// Motion by as much in the opposite direction.
    MovedBack,
}

#[derive(Clone, Copy)]
struct Case {
    gloss: bool,
    view: usize,
    motion: Motion,
    /// Samples per pixel of this frame; then of the previous one.
    spp: u32,
    last_spp: u32,
    seed: u64,
}

/// An eye's images of the previous frame.
struct Bits {
    guide: Vec<[u32; 4]>,
    moments: Vec<[u32; 4]>,
    light: Vec<[u32; 4]>,
}

/// Half floats that are not finite, which are never packed. As floats they are not finite either.
const INFINITE: [u32; 4] = [0x7f80_7c00; 4];

/// Makes random history. `damaged` is the fraction of pixels with numbers that are not finite, and of those with
/// numbers that lead to such.
fn history(
    random: &mut Random,
    constants: &Constants,
    (view, eye): (usize, Eye),
    format: Format,
    damaged: f64,
) -> Bits {
    let mut seen_by = constants.clone();
    seen_by.eyes[view] = eye;
    let guide = Wall::new(0.003, 0.3, 0.05).guides(random, &seen_by, view);
    // The right eye lacks history in many pixels, so that the left eye's is used.
    let lost = if view == 1 { 0.6 } else { 0.15 };
    let statistics = |random: &mut Random| {
        let mean = DVec2::new(random.within(0.2..1.5), random.within(0.0..0.3));
        let mean = random.pick(&[mean, mean, mean, mean, mean.with_x(ABSENT), mean.with_y(ABSENT)]);
        let mean = if format.gloss { mean } else { mean.with_y(0.0) };
        let spread = random.pick(&[0.001, 0.1, LARGEST_VARIANCE]);
        let moments = Moments {
            mean,
            variance: DVec2::new(spread * random.within(0.5..1.0), spread * random.within(0.0..0.2)),
            recent: mean.x.max(0.0) * random.within(0.6..1.6),
            samples: if random.chance(lost) { 0.0 } else { random.within(0.3..150.0) },
            frames: random.pick(&[1.0, 2.0, 3.0, 5.0, 7.0, 20.0, 100.0, 255.0]),
            material: random.pick(&MATERIALS),
        };
        let mut bits = moments.pack(format);
        if random.chance(damaged) {
            // A variance near the largest float, from so few samples that the variance of the mean overflows.
            bits = [bits[0], if format.gloss { 0x7c00 } else { 3e38f32.to_bits() }, 0x3800_3400, bits[3] | 0x0800_0000];
        }
        bits
    };
    let light = |random: &mut Random| match random.chance(damaged) {
        true => INFINITE,
        false => {
            let light = random.light(1.0);
            format.pack(&Light { variance: DVec2::splat(UNKNOWN), ..random.with_absent(light) })
        }
    };
    Bits {
        guide,
        moments: (0..constants.area()).map(|_| statistics(random)).collect(),
        light: (0..constants.area()).map(|_| light(random)).collect(),
    }
}

/// Materials of surfaces, some of which are seen in mirrors.
const MATERIALS: [u32; 6] = [7, 7, 7, 8, 7 | MIRRORED, 7 | MIRRORED];

/// Returns the length of the path to a mirrored surface, material and flags; and radiance.
fn present(random: &mut Random, format: Format) -> ([u32; 4], [u32; 4]) {
    let flags = random.pick(&[0, 0, 0, VIEW_DEPENDENT]) | (random.bits() & 0x3f) << 24;
    let radiance = match random.bits() % 40 {
        0 => [INFINITE[0], INFINITE[1], INFINITE[2], SAMPLED],
        1 => format.pack_sampled(&random.light(1e20)),
        2..12 => [0; 4],
        12..26 => {
            let light = random.light(1.5);
            format.pack_sampled(&random.with_absent(light))
        }
        _ => {
            let variance = DVec2::new(random.within(0.0..0.4), random.within(0.0..0.1));
            let light = random.light(1.5);
            format.pack_sampled_with(&Light { variance, ..random.with_absent(light) })
        }
    };
    let length = random.within(4.0..5.0) as f32;
    ([1, length.to_bits(), 3, random.pick(&MATERIALS) | flags], radiance)
}

/// Returns a pixel whose ray has the unit direction `ray`.
fn now(format: Format, (eye, ray): (&Eye, DVec3), hit: [u32; 4], guide: [u32; 4], radiance: [u32; 4]) -> Now {
    let [_, length, _, hit] = hit;
    let surface = Surface::unpack(guide);
    let mirrored = eye.origin.as_dvec3() + ray * f64::from(f32::from_bits(length));
    Now {
        image: if hit & MIRRORED != 0 { mirrored } else { surface.as_ref().map_or(DVec3::ZERO, |s| s.position) },
        surface,
        material: hit & MATERIAL_MASK,
        roughness: f64::from((hit >> 24) & 63) / 63.0,
        is_view_dependent: hit & VIEW_DEPENDENT != 0,
        light: format.unpack_sampled(radiance),
    }
}

fn before(format: Format, eye: Eye, bits: &Bits) -> Before {
    Before {
        eye,
        guide: bits.guide.iter().map(|bits| Surface::unpack(*bits)).collect(),
        moments: bits.moments.iter().map(|bits| Moments::unpack(format, *bits)).collect(),
        light: bits.light.iter().map(|bits| format.unpack(*bits)).collect(),
    }
}

/// Tolerance for weights. Image points have errors of up to 5e-6 pixels, and so have the weights of the pixels around
/// them. These are divided by their sum, which is at least 0.01.
const WEIGHTS: f64 = 5e-4;
/// Largest variance of a history. Variances of neighbouring pixels differ by far more than other values, so an error in
/// weights causes an error relative to the largest.
const LARGEST_VARIANCE: f64 = 0.5;

/// Compares a pixel of both output images.
#[track_caller]
fn assert_pixel(format: Format, light: [u32; 4], moments: [u32; 4], after: &After, place: &str) {
    let (shown, got) = (format.unpack(light), Moments::unpack(format, moments));
    let want = &after.moments;
    let squares = 1e-6 * (1.0 + want.mean.max_element() + after.light.luminances().max_element()).powi(2);
    let told = || format!("{place}: {shown:?}, {got:?} instead of {:?}, {want:?}", after.light);
    assert!(format.holds(light, &after.light, WEIGHTS, squares), "{}", told());
    assert_eq!(got.material, want.material, "{place}");
    if after.light.variance.x == MISSING {
        assert_eq!(moments, [0, 0, 0, want.material], "{}", told());
        return;
    }
    let (relative, step) = if format.gloss { (WEIGHTS + HALF, HALF_STEP) } else { (WEIGHTS, 0.0) };
    for c in 0..if format.gloss { 2 } else { 1 } {
        assert!(is_near(got.mean[c], want.mean[c], relative, step), "mean {c} of {}", told());
        let allowed = squares + WEIGHTS * LARGEST_VARIANCE + (want.variance[c].sqrt() + step) * step;
        assert!(is_near(got.variance[c], want.variance[c], 2.0 * relative, allowed), "variance {c} of {}", told());
    }
    assert!(is_near(got.recent, want.recent, WEIGHTS + HALF, 0.0), "recent mean of {}", told());
    assert!(is_near(got.samples, want.samples, WEIGHTS + HALF, 0.0), "samples of {}", told());
    // Frame counts are rounded to whole numbers.
    assert!((got.frames - want.frames).abs() <= 0.5 + WEIGHTS * want.frames, "frames of {}", told());
}

fn compare(case: Case, cases: &mut Cases) {
    let mut random = Random::new(case.seed);
    let mut constants = Constants { spp: case.spp, ..Constants::new(WIDTH, HEIGHT) };
    constants.centre = Vec2::new(0.3, 0.8);
    let format = Format { gloss: case.gloss };
    // Motion by about 1.5 pixels, within the limit of one row.
    let way = DVec3::new(0.07, -0.05, 0.02);
    let eyes_before = match case.motion {
        Motion::Moved => constants.eyes.map(|eye| eye.moved(way, -0.02, -0.06)),
        Motion::MovedBack => constants.eyes.map(|eye| eye.moved(-way, 0.02, 0.06)),
        Motion::Slow => constants.eyes.map(|eye| eye.moved(0.01 * way, 0.0, 0.0)),
        Motion::None | Motion::Still => constants.eyes,
    };
    constants.history_rows = (!matches!(case.motion, Motion::None)).then_some(1);
    // With hardly any motion, image points are whole pixels except for rounding, which decides if a neighbour counts.
    let damaged = if matches!(case.motion, Motion::Moved | Motion::MovedBack) { 0.02 } else { 0.0 };
    let previous = Constants { eyes: eyes_before, spp: case.last_spp, ..constants.clone() }.as_previous();
    for stripe in stripes() {
        let guide = Wall::new(0.002, 0.2, 0.05).guides(&mut random, &constants, case.view);
        let (hit, radiance): (Vec<_>, Vec<_>) = (0..constants.area()).map(|_| present(&mut random, format)).unzip();
        let histories =
            [0, case.view].map(|view| history(&mut random, &constants, (view, eyes_before[view]), format, damaged));
        let tally: Vec<u32> = (0..constants.area()).map(|_| random.bits()).collect();
        let words = [0, 1].map(|_| random.rubbish::<4>(constants.area()));
        let valid = |pixels: &[[u32; 4]]| stripe.valid(WIDTH, pixels);
        let buffers = [
            ("hit_image", stripe.own(WIDTH, &hit)),
            ("guide_image", stripe.own(WIDTH, &guide)),
            ("radiance", stripe.own(WIDTH, &radiance)),
            ("last_guide", valid(&histories[1].guide)),
            ("last_moments", valid(&histories[1].moments)),
            ("last_history", valid(&histories[1].light)),
            ("left_guide", valid(&histories[0].guide)),
            ("left_moments", valid(&histories[0].moments)),
            ("left_history", valid(&histories[0].light)),
            ("accumulated", Buffer::image(&words[0])),
            ("moments", Buffer::image(&words[1])),
            ("previous", Buffer::whole(&previous)),
            ("tally_image", Buffer::image(&tally)),
            ("light_change", Buffer::whole(&[0.0f32])),
        ];
        let overrides = [("HAS_GLOSS", case.gloss), ("MARKS_ABSENT", true), ("HAS_MIRRORS", true), ("SOBOL", true)];
        let pass = stripe.pass(case.view, [0; 3]);
        let outputs = Kernel::new("accumulate", &overrides).run(&constants, pass, WIDTH, &buffers);
        let (light, moments) = (outputs.get::<[u32; 4]>("accumulated"), outputs.get::<[u32; 4]>("moments"));
        let counted = outputs.get::<u32>("tally_image");
        let own = || before(format, eyes_before[case.view], &histories[1]);
        let left = || before(format, eyes_before[0], &histories[0]);
        let before = match (case.motion, case.view) {
            (Motion::None, _) => vec![],
            (_, 0) => vec![own()],
            _ => vec![own(), left()],
        };
        let Case { gloss, view, last_spp, .. } = case;
        let twin = Twin { constants: &constants, last_spp, stripe: &stripe, gloss, view, before: &before };
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let eye = &constants.eyes[case.view];
            let ray = eye.ray(constants.through(x, y), constants.size());
            let now = now(format, (eye, ray), hit[at], guide[at], radiance[at]);
            let place = format!("({x}, {y}) of {stripe:?}");
            let after = twin.pixel(y, &now, cases);
            let dropped = after.as_ref().map_or(now.is_damaged(), |after| after.dropped);
            match after {
                None => {
                    let own = now.light.filter(|_| !dropped).unwrap_or_default().unmarked();
                    let own = Light { variance: DVec2::ZERO, ..own };
                    let expected = (format.pack(&own), [0, 0, 0, now.material]);
                    assert_eq!((light[at], moments[at]), expected, "{place}");
                }
                Some(after) => assert_pixel(format, light[at], moments[at], &after, &place),
            }
            let counts = Counts::unpack(tally[at]).with_dropped(u32::from(dropped));
            assert_eq!(Counts::unpack(counted[at]), counts, "{place}");
        }
    }
}

/// Compares both formats, whose inputs must cover these cases, and the first also `plain`.
fn hold(case: Case, met: &[&'static str], plain: &[&'static str]) {
    for (gloss, seed) in [(false, case.seed), (true, case.seed + 1)] {
        let mut cases = Cases::default();
        compare(Case { gloss, seed, ..case }, &mut cases);
        cases.assert_met(met);
        cases.assert_met(if gloss { &[] } else { plain });
    }
}

const CASE: Case = Case { gloss: false, view: 0, motion: Motion::None, spp: 1, last_spp: 1, seed: 0 };

/// Cases that occur in every frame with a previous one.
const WITH_HISTORY: [&str; 16] = [
    "history in a mirror",
    "history outside",
    "no surface",
    "sampled",
    "not sampled",
    "nothing",
    "own history",
    "history that is cut short",
    "history without a lobe",
    "light without a lobe",
    "light that is not finite",
    "light that has changed",
    "variance that is known",
    "variance that is unknown",
    "recent frames of few samples",
    "recent frames of as many samples as all",
];

#[test]
fn accumulate_starts_history_with_the_first_frame() {
    let met = ["no surface", "sampled", "nothing", "light that is not finite", "variance that is unknown"];
    hold(Case { view: 1, spp: 3, last_spp: 3, seed: 111, ..CASE }, &met, &[]);
}

#[test]
fn accumulate_averages_while_the_eyes_are_still() {
    hold(Case { motion: Motion::Still, last_spp: 16, seed: 113, ..CASE }, &WITH_HISTORY, &[]);
}

/// Resampling hardly blurs, but view-dependent light changes.
#[test]
fn accumulate_averages_while_the_eyes_move_slowly() {
    hold(Case { motion: Motion::Slow, seed: 119, ..CASE }, &WITH_HISTORY, &["view-dependent history"]);
}

#[test]
fn accumulate_follows_the_motion_of_the_eyes() {
    let met = [&WITH_HISTORY[..], &["history that is not finite"]].concat();
    let plain = ["view-dependent history", "a sum that is not finite"];
    hold(Case { motion: Motion::Moved, spp: 2, seed: 115, ..CASE }, &met, &plain);
}

#[test]
fn accumulate_falls_back_to_left_eye_history() {
    let met = [&WITH_HISTORY[..], &["the left eye's history"]].concat();
    hold(Case { view: 1, motion: Motion::MovedBack, last_spp: 4, seed: 117, ..CASE }, &met, &[]);
}
