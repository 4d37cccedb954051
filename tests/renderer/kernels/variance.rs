//! The variance that guides the temporal filter.

use glam::DVec2;

use super::camera::Constants;
use super::edges::Surface;
use super::filters::{Filter, listed};
use super::harness::Kernel;
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{FINISHED, Format, LEAST_WEIGHT, Light, MISSING, MeanLight, UNKNOWN};

/// Maximum distance to the centre's plane for the same surface, as a fraction of the distance to the eye.
const REACH: f64 = 0.02;
/// Weight of other surfaces' pixels for a pixel without light of its own.
const LAST_RESORT: f64 = 1e-6;
/// Factor on estimated variances.
const DOUBT: f64 = 9.0;

impl Filter<'_, Light> {
    /// Returns valid pixels at most `reach` rows and columns away, with their offsets.
    fn around(&self, pixel: (u32, u32), reach: i32) -> impl Iterator<Item = ((i32, i32), usize)> {
        let offsets = (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (dx, dy)));
        offsets.filter_map(move |o| self.constants.tap(pixel, o, &self.stripe.valid).map(|tap| (o, tap)))
    }

    /// Returns the light with its variance; none without a surface, whose light stays as it is.
    fn with_variance(&self, pixel: (u32, u32), cases: &mut Cases) -> Option<Light> {
        let at = self.constants.index(pixel.0, pixel.1);
        let Some(surface) = &self.guide[at] else {
            cases.meet("no surface");
            return None;
        };
        let centre = &self.source[at];
        if centre.variance.x >= 0.0 {
            cases.meet("known");
            return Some(Light { variance: self.smoothed(pixel), ..*centre });
        }
        let is_missing = centre.variance.x == MISSING;
        let reach = surface.reach(&self.constants.eyes[self.view], REACH);
        let (mut matte, mut gloss, mut weight) = (MeanLight::default(), MeanLight::default(), 0.0);
        let mut lobes = DVec2::ZERO;
        let (mut first, mut second) = (DVec2::ZERO, DVec2::ZERO);
        for (offset, tap) in self.around(pixel, 3) {
            let light = &self.source[tap];
            if light.variance.x == MISSING {
                continue;
            }
            let Some(other) = &self.guide[tap] else { continue };
            let w = match offset {
                (0, 0) => 1.0,
                _ if is_missing => surface.weight(reach, other, 0.0).max(LAST_RESORT),
                _ => surface.weight(reach, other, 0.0),
            };
            matte.add(light.matte, w);
            gloss.add(light.gloss, w);
            first += light.luminances() * w;
            second += light.luminances().powf(2.0) * w;
            weight += w;
            lobes += light.lobes() * w;
        }
        let least = if is_missing { 0.0 } else { LEAST_WEIGHT };
        let (matte, gloss) = (matte.above(least), gloss.above(least));
        if weight == 0.0 {
            cases.meet("nothing around");
            return Some(Light { matte, gloss, variance: DVec2::splat(MISSING) });
        }
        if lobes.min_element() == 0.0 {
            cases.meet("no lobe around");
        }
        cases.meet(if is_missing { "missing" } else { "unknown" });
        let of_lobes =
            |sum: DVec2| DVec2::from_array([0, 1].map(|i| if lobes[i] > least { sum[i] / lobes[i] } else { 0.0 }));
        let mean = of_lobes(first);
        let variance = DOUBT * (of_lobes(second) - mean * mean).max(DVec2::ZERO);
        Some(Light { matte, gloss, variance })
    }

    /// Returns the mean of the known variances around a pixel, by a tent of 3x3 pixels.
    fn smoothed(&self, pixel: (u32, u32)) -> DVec2 {
        let (mut sum, mut weight) = (DVec2::ZERO, DVec2::ZERO);
        for ((dx, dy), tap) in self.around(pixel, 1).filter(|&(_, tap)| self.source[tap].variance.x >= 0.0) {
            let w = f64::from((2 - dx.abs()) * (2 - dy.abs())) / 16.0 * self.source[tap].lobes();
            sum += self.source[tap].variance * w;
            weight += w;
        }
        sum / weight.max(DVec2::splat(0.0625))
    }
}

fn compare(gloss: bool, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants::new(WIDTH, HEIGHT);
    let format = Format { gloss };
    let mut cases = Cases::default();
    for (round, stripe) in stripes().iter().enumerate() {
        let view = round % 2;
        // In one round so few pixels have light that some find none.
        let (sky, missing) = if round == 2 { (0.5, 0.9) } else { (0.1, 0.3) };
        let guide = Wall::new(0.03, 0.6, sky).guides(&mut random, &constants, view);
        // In another round light is so bright that it is clamped.
        let unit = if round == 3 { 1e18 } else { 1.0 };
        let source: Vec<_> = (guide.iter())
            .map(|bits| {
                if Surface::unpack(*bits).is_none() {
                    return format.pack(&random.light(2.0));
                }
                let known = DVec2::new(random.within(0.0..2.0), random.within(0.0..0.5));
                if random.chance(missing) {
                    // Missing light is black, but the result must not depend on it.
                    return format.pack(&Light { variance: DVec2::splat(MISSING), ..random.light(9.0) });
                }
                let [unknown, finished] = [UNKNOWN, FINISHED].map(DVec2::splat);
                let variance = random.pick(&[known, known, known, unknown, unknown, finished]);
                let light = random.light(2.0 * unit);
                let light = random.with_absent(light);
                // The variance of an absent lobe is 0.
                let variance = if variance.x < 0.0 { variance } else { variance * light.lobes() };
                format.pack(&Light { variance, ..light })
            })
            .collect();
        let kernel = Kernel::new("variance", &[("HAS_GLOSS", gloss), ("MARKS_ABSENT", true)]);
        let (place, part) = ((&constants, stripe, view), round as u32 % 2);
        let is_finished = |at: usize| format.unpack(source[at]).variance.x == FINISHED;
        let (listed, inputs) = (listed(&mut random, constants.area(), is_finished), [&guide[..], &source]);
        let unpack = |bits| format.unpack(bits);
        let filter = Filter::run(&kernel, &mut random, place, [part, 0, 0], inputs, Some(&listed), unpack);
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let got = filter.filtered[at];
            if part != 0 && !listed.contains(&(at as u32)) {
                cases.meet("not listed");
                assert_eq!(got, filter.before[at], "({x}, {y}) of round {round}");
                continue;
            }
            if is_finished(at) {
                continue;
            }
            match filter.with_variance((x, y), &mut cases) {
                None => assert_eq!(got, source[at], "({x}, {y}) of round {round}"),
                Some(light) => {
                    let unpacked = format.unpack(got);
                    // Variance is a difference of squares.
                    let rounding = DOUBT * 1e-6 * light.luminances().max_element().powi(2);
                    let holds = format.holds(got, &light, 1e-5, rounding);
                    assert!(holds, "({x}, {y}) of round {round}: {unpacked:?} instead of {light:?}");
                }
            }
        }
    }
    cases.assert_met(&["no surface", "known", "unknown", "missing", "not listed", "nothing around"]);
}

#[test]
fn variance_of_each_lobe_is_smoothed_or_estimated() {
    compare(false, 81);
    compare(true, 82);
}
