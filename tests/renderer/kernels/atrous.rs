//! One iteration of the edge-avoiding filter of frames without history.

use glam::{DVec2, DVec3};

use super::camera::Constants;
use super::edges::comparable;
use super::filters::Filter;
use super::harness::Kernel;
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{Format, LEAST_WEIGHT, Light, MeanLight, SAMPLED, is_absent};

/// Maximum distance to the centre's plane for the same surface, as a fraction of the distance to the eye.
const REACH: f64 = 0.02;
/// Cubic B-spline at the integers.
const SPLINE: [f64; 5] = [1.0 / 16.0, 1.0 / 4.0, 3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];

/// One iteration over an image, in which pixels without light are left to the denoiser.
struct Twin<'a> {
    filter: Filter<'a, Option<Light>>,
    /// True if pixels may be left to the denoiser.
    sparse: bool,
    step: u32,
    inverse_sigma2: f64,
    /// Number of a layer's iterations that do not compare light. If no pixel is left to the denoiser, `inverse_sigma2`
    /// decides instead.
    blind_iterations: u32,
}

/// Result of a pixel.
enum Filtered {
    Kept,
    Empty,
    Light(Light),
}

impl Twin<'_> {
    fn pixel(&self, (x, y): (u32, u32), cases: &mut Cases) -> Filtered {
        let at = self.filter.constants.index(x, y);
        let Some(surface) = &self.filter.guide[at] else {
            cases.meet("no surface");
            return Filtered::Kept;
        };
        // A layer with K iterations takes part in the last K, with steps from 2^(K-1) to 1.
        let iterations =
            self.filter.constants.foveation.layer_iterations[self.filter.constants.layer((x, y), self.filter.view)];
        let left = self.step.ilog2() + 1;
        if self.sparse && left > iterations {
            cases.meet("another layer's iteration");
            return Filtered::Kept;
        }
        let is_last = self.step == 1;
        let is_empty = self.filter.source[at].is_none();
        let compares = !self.sparse || (!is_empty && iterations - left >= self.blind_iterations);
        let inverse_sigma2 = if compares { self.inverse_sigma2 } else { 0.0 };
        let centre = self.filter.source[at].unwrap_or_default();
        let reach = surface.reach(&self.filter.constants.eyes[self.filter.view], REACH);
        let (mut matte, mut gloss, mut weight) = (MeanLight::default(), MeanLight::default(), 0.0);
        for (dx, dy) in (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dx, dy))) {
            let offset = (dx * self.step as i32, dy * self.step as i32);
            let Some(tap) = self.filter.constants.tap((x, y), offset, &self.filter.stripe.valid) else {
                cases.meet("a tap that is not valid");
                continue;
            };
            let (Some(other), Some(value)) = (&self.filter.guide[tap], &self.filter.source[tap]) else { continue };
            let mut similarity = |lobe: fn(&Light) -> DVec3| {
                if (dx, dy) == (0, 0) {
                    return 1.0;
                }
                let color = |light: &Light| comparable(lobe(&light.unmarked()));
                // A lobe without light has none to compare with.
                let inverse_sigma2 = if is_absent(lobe(&centre)) { 0.0 } else { inverse_sigma2 };
                let difference = (color(&centre) - color(value)).length_squared() * inverse_sigma2;
                let similarity = surface.weight(reach, other, difference);
                if is_empty && is_last && similarity < 1e-6 {
                    cases.meet("a last resort");
                    return 1e-6;
                }
                similarity
            };
            let k = SPLINE[(dx + 2) as usize] * SPLINE[(dy + 2) as usize];
            let w = k * similarity(|light| light.matte);
            matte.add(value.matte, w);
            gloss.add(value.gloss, k * similarity(|light| light.gloss));
            weight += w;
        }
        let least = if is_empty { 0.0 } else { LEAST_WEIGHT };
        let light = Light { matte: matte.above(least), gloss: gloss.above(least), ..centre };
        if is_absent(light.matte) || is_absent(centre.matte) {
            cases.meet("an absent lobe");
        }
        if !self.sparse {
            cases.meet("filtered");
            return Filtered::Light(light);
        }
        // An empty pixel is filled only if the taps have at least half of the expected samples around it.
        let enough = match is_empty && !is_last {
            true => 0.5 * self.filter.constants.sampling_probability((x, y), self.filter.view),
            false => 0.0,
        };
        if weight <= enough {
            cases.meet("stays empty");
            return Filtered::Empty;
        }
        cases.meet(if is_empty { "filled" } else { "filtered" });
        Filtered::Light(light)
    }
}

/// Runs the last `count` iterations of a filter, each on independent light.
fn compare([gloss, sparse, layers]: [bool; 3], count: u32, seed: u64, expected: &[&'static str]) {
    let mut random = Random::new(seed);
    let mut constants = Constants::new(WIDTH, HEIGHT);
    constants.foveation.layers = layers;
    constants.foveation.sampled_fraction = if sparse { 0.5 } else { 1.0 };
    constants.foveation.layer_iterations = if layers { [count - 2, count - 1, count] } else { [count; 3] };
    let format = Format { gloss };
    let overrides =
        [("HAS_GLOSS", gloss), ("MARKS_ABSENT", true), ("SOBOL", true), ("SPARSE", sparse), ("FOVEATED", layers)];
    let mut cases = Cases::default();
    for (index, stripe) in (0..count).flat_map(|index| stripes().into_iter().map(move |stripe| (index, stripe))) {
        let view = (index % 2) as usize;
        let guide = Wall::new(0.02, 0.6, 0.1).guides(&mut random, &constants, view);
        let texel = |random: &mut Random| match sparse && random.chance(0.6) {
            true => [0; 4],
            false => {
                let light = random.light(1.5);
                format.pack_sampled(&random.with_absent(light))
            }
        };
        let source: Vec<_> = (0..constants.area()).map(|_| texel(&mut random)).collect();
        let step = 1 << (count - 1 - index);
        let (inverse_sigma2, blind) = if sparse { (3.0f32, 2) } else { (if index < 2 { 0.0 } else { 3.0 }, 0) };
        let kernel = Kernel::new("atrous", &overrides);
        let (place, args) = ((&constants, &stripe, view), [step, inverse_sigma2.to_bits(), blind]);
        let unpack = |bits| format.unpack_sampled(bits);
        let filter = Filter::run(&kernel, &mut random, place, args, [&guide, &source], None, unpack);
        let twin = Twin { filter, sparse, step, inverse_sigma2: inverse_sigma2.into(), blind_iterations: blind };
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let (got, place) = (twin.filter.filtered[at], format!("({x}, {y}) of iteration {index}, {stripe:?}"));
            match twin.pixel((x, y), &mut cases) {
                Filtered::Kept => assert_eq!(got, source[at], "{place}"),
                Filtered::Empty => assert_eq!(got, [0; 4], "{place}"),
                // Drivers' exponential functions have errors of a few units in the last place of their argument, which
                // is at most 80.
                Filtered::Light(light) => {
                    let (light, unpacked) = (Light { variance: DVec2::ZERO, ..light }, format.unpack(got));
                    let holds = format.holds([got[0], got[1], got[2], 0], &light, 2e-5, 0.0);
                    assert!(holds && got[3] == SAMPLED, "{place}: {unpacked:?} instead of {light:?}");
                }
            }
        }
    }
    cases.assert_met(&["no surface", "a tap that is not valid", "filtered", "an absent lobe"]);
    cases.assert_met(expected);
}

#[test]
fn atrous_averages_along_surfaces() {
    compare([false, false, false], 3, 71, &[]);
    compare([true, false, false], 3, 75, &[]);
}

#[test]
fn atrous_fills_empty_pixels_given_enough_light() {
    compare([true, true, false], 4, 72, &["filled", "stays empty", "a last resort"]);
}

#[test]
fn atrous_layers_join_in_the_last_iterations() {
    compare([false, true, true], 4, 73, &["filled", "stays empty", "a last resort", "another layer's iteration"]);
}
