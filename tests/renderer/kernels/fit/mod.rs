//! Blockwise regression of light on features of surfaces.

mod twin;

use glam::DVec3;

use self::twin::{BLOCK, DISPLACEMENTS, FEATURES, Fit, Pixel};
use super::camera::Constants;
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{Cases, Random};
use super::pack::{Format, HALF, HALF_STEP, Light, NO_NORMAL, SAMPLED, is_finite, pack_guide};

/// Size at which the last blocks without displacement are one pixel wide or high.
const WIDTH: u32 = 65;
const HEIGHT: u32 = 33;

/// Geometry of the blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// Normals vary strongly, and others only by packing errors.
    Rough,
    /// One normal along an axis and one coordinate: some columns are zero, others multiples of one another.
    Level,
    /// One normal, and linearly dependent coordinates.
    Tilted,
    /// A plane far from the world's origin, where one coordinate consists of rounding errors.
    Distant,
    /// A wavy surface.
    Wavy,
    /// A single point.
    Point,
}

/// Distribution of light.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lit {
    Noisy,
    /// Light in which channels are absent.
    Marked,
    /// Linear combination of the coordinates.
    Exact,
    /// Values near the largest float among dark pixels.
    Huge,
    Dark,
    /// Light in very few pixels.
    Sparse,
    /// No pixel with light.
    Nowhere,
}

fn surface(shape: Shape, random: &mut Random, (x, y): (u32, u32)) -> (DVec3, DVec3) {
    let at = DVec3::new(f64::from(x) * 0.05 - 1.0, f64::from(y) * 0.04 - 0.7, 0.0);
    let tilt = DVec3::new(0.3, -0.5, 0.8).normalize();
    let on_plane = at.with_z(-(tilt.x * at.x + tilt.y * at.y) / tilt.z);
    match shape {
        Shape::Rough => (at.with_z(random.within(-0.5..0.5)), random.tilted(DVec3::Z, 1.2)),
        Shape::Level => (at.with_z(0.37), DVec3::Z),
        Shape::Tilted => (on_plane, tilt),
        Shape::Distant => (at + DVec3::new(70.0, -40.0, 25.0 + random.within(-4e-6..4e-6)), tilt),
        Shape::Wavy => {
            let height = 0.3 * (2.0 * at.x).sin() + 0.2 * (3.0 * at.y).cos();
            (at.with_z(height), DVec3::new(-0.6 * (2.0 * at.x).cos(), 0.6 * (3.0 * at.y).sin(), 1.0).normalize())
        }
        Shape::Point => (DVec3::new(1.0, 2.0, 3.0), DVec3::Y),
    }
}

fn light(lit: Lit, random: &mut Random, at: DVec3) -> Option<DVec3> {
    match lit {
        Lit::Noisy | Lit::Marked => random.chance(0.8).then(|| random.color(1.0)),
        Lit::Exact => Some(DVec3::new(5.0 + at.x, 4.0 - at.y, 6.0 + 0.5 * at.x + at.y)),
        Lit::Huge => Some(DVec3::splat(if random.chance(0.1) { 3e38 } else { 0.0 })),
        Lit::Dark => Some(DVec3::ZERO),
        Lit::Sparse => random.chance(0.006).then(|| random.color(1.0)),
        Lit::Nowhere => None,
    }
}

/// Returns images of guides and light.
fn images(
    random: &mut Random,
    (constants, format): (&Constants, Format),
    shape: Shape,
    lit: Lit,
) -> (Vec<[u32; 4]>, Vec<[u32; 4]>) {
    let pixels = (0..constants.height).flat_map(|y| (0..constants.width).map(move |x| (x, y)));
    pixels
        .map(|pixel| {
            let (position, normal) = surface(shape, random, pixel);
            let is_sky = lit != Lit::Exact && random.chance(0.1);
            let guide = if is_sky { [0, 0, 0, NO_NORMAL] } else { pack_guide(position, normal) };
            let light = light(lit, random, position);
            let count = random.pick(&[1, 2, 255]);
            let is_lit = light_is_told(lit, random, light);
            let matte = light.unwrap_or_default();
            let light = Light { matte, gloss: 0.3 * matte, ..Light::default() };
            let light = if matches!(lit, Lit::Marked) { random.with_absent(light) } else { light };
            let [x, y, z, _] = format.pack(&light);
            (guide, [x, y, z, random.bits() & 0x00ff_ffff | if is_lit { count << 24 } else { 0 }])
        })
        .unzip()
}

/// Returns true if the pixel counts as lit. Where light may be absent, black pixels do not.
fn light_is_told(lit: Lit, random: &mut Random, light: Option<DVec3>) -> bool {
    match lit {
        Lit::Noisy | Lit::Sparse | Lit::Marked => light.is_some(),
        Lit::Exact | Lit::Huge => true,
        Lit::Dark => random.chance(0.9),
        Lit::Nowhere => false,
    }
}

fn run(
    (constants, format): (&Constants, Format),
    stripe: &Stripe,
    noise: f32,
    guide: &[[u32; 4]],
    source: &[[u32; 4]],
) -> Vec<[u32; 4]> {
    let (width, rows) = (constants.width, stripe.rows.end - stripe.rows.start);
    let groups = [width, rows].map(|length| (length + 2 * (BLOCK - 1)) / BLOCK);
    let buffers = [
        ("guide_image", stripe.valid(width, guide)),
        ("source", stripe.valid(width, source)),
        ("fitted", Buffer::image(&vec![[0x7fc0_0001; 4]; constants.area()])),
    ];
    let kernel = Kernel::new("fit", &[("HAS_GLOSS", format.gloss), ("MARKS_ABSENT", true)]);
    kernel.run_groups(constants, stripe.pass(1, [noise.to_bits(), 0, 0]), groups, &buffers).get("fitted")
}

/// Lobes of a format.
const LOBES: [fn(&Light) -> DVec3; 2] = [|light| light.matte, |light| light.gloss];

fn lobes(format: Format) -> &'static [fn(&Light) -> DVec3] {
    &LOBES[..if format.gloss { 2 } else { 1 }]
}

/// Unpacks light whose last word is something else.
fn unpacked(format: Format, [x, y, z, _]: [u32; 4]) -> Light {
    format.unpack([x, y, z, 0])
}

fn compare(gloss: bool, index: u32, shape: Shape, lit: Lit, seed: u64, cases: &mut Cases) {
    let mut random = Random::new(seed);
    let constants = Constants { index, ..Constants::new(WIDTH, HEIGHT) };
    let format = Format { gloss };
    let (guide, source) = images(&mut random, (&constants, format), shape, lit);
    let (left, above) = DISPLACEMENTS[index as usize % 16];
    // Like in the graph, kernels may read whole blocks around a stripe.
    for rows in [0..HEIGHT, 3..12, 32..33, 15..17] {
        let valid = rows.start.saturating_sub(BLOCK - 1)..(rows.end + BLOCK - 1).min(HEIGHT);
        let stripe = Stripe { rows: rows.clone(), valid };
        let fitted = run((&constants, format), &stripe, 0.0, &guide, &source);
        for block in 0..(WIDTH + left).div_ceil(BLOCK) {
            for band in 0..(HEIGHT + above).div_ceil(BLOCK) {
                let columns = (block * BLOCK).saturating_sub(left)..((block + 1) * BLOCK - left).min(WIDTH);
                let lines = (band * BLOCK).saturating_sub(above)..((band + 1) * BLOCK - above).min(HEIGHT);
                if columns.len() == 1 || lines.len() == 1 {
                    cases.meet("a block that is one pixel wide or high");
                }
                let places: Vec<_> = lines.flat_map(|y| columns.clone().map(move |x| (x, y))).collect();
                for lobe in lobes(format) {
                    let pixel = |&(x, y): &(u32, u32)| {
                        let at = constants.index(x, y);
                        let light = (source[at][3] >> 24 != 0).then(|| lobe(&unpacked(format, source[at])));
                        Pixel { surface: Surface::unpack(guide[at]), light }
                    };
                    let pixels: Vec<Pixel> = places.iter().map(pixel).collect();
                    let fits = Fit::channels(&pixels);
                    for (&(x, y), pixel) in places.iter().zip(&pixels).filter(|((_, y), _)| rows.contains(y)) {
                        let got = fitted[constants.index(x, y)];
                        let place = format!("({x}, {y}) of frame {index}, {shape:?}, {lit:?}, {stripe:?}");
                        let Some(surface) = &pixel.surface else {
                            cases.meet("no surface");
                            let [x, y, z, _] = source[constants.index(x, y)];
                            assert_eq!(got, [x, y, z, SAMPLED], "{place}");
                            continue;
                        };
                        let Some(fits) = &fits else {
                            cases.meet("a block without light");
                            assert_eq!(got, [0; 4], "{place}");
                            continue;
                        };
                        assert_eq!(got[3], SAMPLED, "{place}");
                        let light = lobe(&unpacked(format, got));
                        for (channel, fit) in fits.iter().enumerate() {
                            let is_lit = pixel.light.is_some_and(|light| light[channel] >= 0.0);
                            assert_channel((format, light[channel]), fit, (surface, is_lit), &place, cases);
                        }
                    }
                }
            }
        }
    }
}

#[track_caller]
fn assert_channel(
    (format, got): (Format, f64),
    fit: &Fit,
    (surface, is_lit): (&Surface, bool),
    place: &str,
    cases: &mut Cases,
) {
    if fit.is_absent {
        cases.meet("an absent channel");
        assert!(got < 0.0, "{place}: {got}");
        return;
    }
    cases.meet(["all features", "features are left out"][usize::from(fit.dropped > 0)]);
    if fit.dropped + 1 == FEATURES {
        cases.meet("one feature is left");
    }
    cases.meet(if is_lit { "lit" } else { "light from others alone" });
    let want = fit.light(surface);
    let half = if format.gloss { HALF * fit.brightest() + HALF_STEP } else { 0.0 };
    let is_sound = got.is_finite() && got >= 0.0 && got <= fit.brightest() + half;
    assert!(is_sound, "{place}: {got}");
    if !fit.is_clear {
        cases.meet("unclear");
        return;
    }
    // Nearly dependent features amplify rounding errors, also in combination, and more outside the lit pixels.
    let rounding = 1e-5 + 2e-7 / (fit.least_added * fit.least_added);
    let allowed = fit.brightest() * rounding * if is_lit { 1.0 } else { 20.0 } + half;
    let off = (got - want).abs();
    let told = (fit.dropped, fit.least_added);
    assert!(off <= allowed, "{place}: {got} instead of {want}, off by {off}, at most {allowed}; {told:?}");
}

#[test]
fn fit_is_the_least_squares_sum_of_features() {
    let mut cases = Cases::default();
    let shapes = [Shape::Rough, Shape::Level, Shape::Tilted, Shape::Distant, Shape::Wavy, Shape::Point];
    let lights = [Lit::Noisy, Lit::Exact, Lit::Huge, Lit::Dark, Lit::Sparse, Lit::Nowhere];
    for (i, shape) in (0..).zip(shapes) {
        for (j, lit) in (0..).zip(lights) {
            compare(false, (7 * i + 4 * j) % 16, shape, lit, 310 + u64::from(6 * i + j), &mut cases);
        }
    }
    assert!(cases.count("unclear") * 20 < cases.count("lit"), "too few blocks are compared");
    cases.assert_met(&[
        "no surface",
        "a block without light",
        "a block that is one pixel wide or high",
        "all features",
        "features are left out",
        "one feature is left",
        "lit",
        "light from others alone",
    ]);
}

/// Each channel is fitted to the pixels that have it, and each lobe on its own.
#[test]
fn fit_ignores_channels_with_zero_albedo() {
    let mut cases = Cases::default();
    for (i, gloss) in [false, true].into_iter().enumerate() {
        compare(gloss, 5, Shape::Wavy, Lit::Marked, 360 + i as u64, &mut cases);
        compare(gloss, 6, Shape::Tilted, Lit::Sparse, 362 + i as u64, &mut cases);
    }
    cases.assert_met(&["lit", "light from others alone", "all features"]);
}

#[test]
fn fit_displaces_blocks_in_each_of_16_frames() {
    let mut cases = Cases::default();
    for index in (0..16).chain([u32::MAX]) {
        compare(false, index, Shape::Tilted, Lit::Noisy, 350, &mut cases);
    }
    let mut places = DISPLACEMENTS.to_vec();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), 16);
}

/// Noise makes all features independent, and the fit follows the light less closely.
#[test]
fn noise_on_features_changes_the_fit_a_little() {
    let mut random = Random::new(371);
    let constants = Constants::new(WIDTH, HEIGHT);
    let format = Format { gloss: false };
    let (guide, source) = images(&mut random, (&constants, format), Shape::Level, Lit::Exact);
    let stripe = Stripe { rows: 0..HEIGHT, valid: 0..HEIGHT };
    let fits = [0.0, 0.01].map(|noise| run((&constants, format), &stripe, noise, &guide, &source));
    let mut off = [0.0f64; 2];
    for at in 0..constants.area() {
        let color = |bits| unpacked(format, bits).matte;
        let want = color(source[at]);
        for (off, fit) in off.iter_mut().zip(&fits) {
            assert!(is_finite(color(fit[at])));
            *off = off.max((color(fit[at]) - want).abs().max_element());
        }
    }
    assert!(off[0] < 1e-3 && off[1] > 10.0 * off[0] && off[1] < 1.0, "{off:?}");
}
