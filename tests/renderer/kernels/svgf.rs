//! One iteration of the variance-guided filter.

use glam::{DVec2, DVec3};

use super::camera::Constants;
use super::edges::Surface;
use super::filters::{Filter, listed};
use super::harness::Kernel;
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{FINISHED, Format, LEAST_WEIGHT, Light, MISSING, MeanLight, UNKNOWN, UNSEEN_SQUARE, is_absent};

/// Maximum distance to the centre's plane for the same surface, as a fraction of the distance to the eye.
const REACH: f64 = 0.02;
/// Squared number of standard deviations by which luminance may differ.
const SIGMA2: f32 = 1.44;

/// Result of a pixel.
enum Filtered {
    /// Unchanged light.
    Kept,
    Light(Light),
}

impl Filter<'_, Light> {
    fn svgf(&self, iteration: u32, (x, y): (u32, u32), cases: &mut Cases) -> Filtered {
        let at = self.constants.index(x, y);
        let Some(surface) = &self.guide[at] else {
            cases.meet("no surface");
            return Filtered::Kept;
        };
        let foveation = &self.constants.foveation;
        // A layer with K iterations takes part in the first K.
        if foveation.layers && iteration >= foveation.layer_iterations[self.constants.layer((x, y), self.view)] {
            cases.meet("another layer's iteration");
            return Filtered::Kept;
        }
        let mut channel = |light, luminance| self.channel(iteration, (x, y), surface, light, luminance, cases);
        let matte = channel(|light: &Light| (light.matte, light.variance.x), |light: &Light| light.luminances().x);
        let gloss = channel(|light: &Light| (light.gloss, light.variance.y), |light: &Light| light.luminances().y);
        cases.meet(match (self.source[at].variance.x >= 0.0, matte.1 >= 0.0) {
            (true, _) => "filtered",
            (false, true) => "filled",
            (false, false) => "nothing around",
        });
        Filtered::Light(Light { matte: matte.0, gloss: gloss.0, variance: DVec2::new(matte.1, gloss.1) })
    }

    /// Filters light of one kind by normalised weights, and its variance by their squares.
    fn channel(
        &self,
        iteration: u32,
        (x, y): (u32, u32),
        surface: &Surface,
        light: fn(&Light) -> (DVec3, f64),
        luminance: fn(&Light) -> f64,
        cases: &mut Cases,
    ) -> (DVec3, f64) {
        let centre = &self.source[self.constants.index(x, y)];
        let is_missing = centre.variance.x < 0.0;
        // A pixel or a lobe without light accepts any light of its surface.
        let accepts_any = is_missing || is_absent(light(centre).0);
        if is_absent(light(centre).0) {
            cases.meet("an absent lobe");
        }
        let reach = surface.reach(&self.constants.eyes[self.view], REACH);
        let (mut mean, mut variances, mut weight, mut found) = (MeanLight::default(), 0.0, 0.0, 0.0);
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
            let step = 1 << iteration;
            let Some(tap) = self.constants.tap((x, y), (dx * step, dy * step), &self.stripe.valid) else { continue };
            let (other, value) = (self.guide[tap], &self.source[tap]);
            let counts = value.variance.x >= 0.0 || value.variance.x == FINISHED;
            let Some(other) = other.filter(|_| counts) else { continue };
            let its_variance = light(value).1.max(0.0);
            let (own, its) = (luminance(centre), luminance(value));
            let noise = f64::from(SIGMA2) * (light(centre).1.max(0.0) + its_variance);
            let allowed = noise + 1e-6 * own * its + UNSEEN_SQUARE;
            let difference = if accepts_any { 0.0 } else { (own - its).powi(2) / allowed };
            let similarity = if (dx, dy) == (0, 0) { 1.0 } else { surface.weight(reach, &other, difference) };
            let k = f64::from((2 - dx.abs()) * (2 - dy.abs())) / 16.0 * similarity;
            mean.add(light(value).0, k);
            variances += its_variance * k * k;
            found += k;
            weight += if is_absent(light(value).0) { 0.0 } else { k };
        }
        let least = if is_missing { 0.0 } else { LEAST_WEIGHT };
        let variance = if weight > least { variances / (weight * weight) } else { 0.0 };
        (mean.above(least), if found > 0.0 { variance } else { MISSING })
    }
}

fn compare(gloss: bool, layers: bool, seed: u64, expected: &[&'static str]) {
    let mut random = Random::new(seed);
    let mut constants = Constants::new(WIDTH, HEIGHT);
    constants.foveation.layers = layers;
    constants.foveation.layer_iterations = [1, 2, 3];
    let format = Format { gloss };
    let overrides =
        [("HAS_GLOSS", gloss), ("MARKS_ABSENT", true), ("SOBOL", true), ("SPARSE", layers), ("FOVEATED", layers)];
    let mut cases = Cases::default();
    for (iteration, stripe) in (0..3).flat_map(|i| stripes().into_iter().map(move |stripe| (i, stripe))) {
        let view = (iteration % 2) as usize;
        // If squared weights underflowed, a pixel without light would get no variance.
        let wall = Wall { stray: 0.0, ..Wall::new(0.02, 0.25, 0.1) };
        let guide = wall.guides(&mut random, &constants, view);
        // In one stripe light is so faint that the visibility threshold decides, and in another so bright that it is
        // clamped.
        let (unit, square) = match stripe.rows.start {
            9 => (1e19, 1e36),
            12 => (1e-10, 1e-20),
            _ => (1.0, 1.0),
        };
        let source: Vec<_> = (guide.iter())
            .map(|bits| {
                if Surface::unpack(*bits).is_none() {
                    return format.pack(&random.light(2.0));
                }
                let variance = match random.bits() % 6 {
                    0 => DVec2::splat(MISSING),
                    1 => DVec2::splat(UNKNOWN),
                    // Finished light is not listed.
                    5 => DVec2::splat(FINISHED),
                    // Exclude such bright light: the shader divides its square by the variance.
                    2 if unit <= 1.0 => DVec2::ZERO,
                    _ => DVec2::new(random.within(0.0..0.3), random.within(0.0..0.1)) * square,
                };
                let brightness = random.pick(&[0.0, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5]);
                let light = random.light(brightness * unit);
                let light = random.with_absent(light);
                // The variance of an absent lobe is 0.
                let variance = if variance.x < 0.0 { variance } else { variance * light.lobes() };
                format.pack(&Light { variance, ..light })
            })
            .collect();
        let kernel = Kernel::new("svgf", &overrides);
        let part = u32::from(random.chance(0.5));
        let (place, args) = ((&constants, &stripe, view), [part, SIGMA2.to_bits(), iteration]);
        let is_finished = |at: usize| format.unpack(source[at]).variance.x == FINISHED;
        let listed = listed(&mut random, constants.area(), is_finished);
        let inputs = [&guide[..], &source];
        let filter = Filter::run(&kernel, &mut random, place, args, inputs, Some(&listed), |bits| format.unpack(bits));
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let (got, place) = (filter.filtered[at], format!("({x}, {y}) of iteration {iteration}, {stripe:?}"));
            if part != 0 && !listed.contains(&(at as u32)) {
                cases.meet("not listed");
                assert_eq!(got, filter.before[at], "{place}");
                continue;
            }
            if is_finished(at) {
                continue;
            }
            match filter.svgf(iteration, (x, y), &mut cases) {
                Filtered::Kept => assert_eq!(got, source[at], "{place}"),
                // Differences may be many deviations, and drivers' exponential functions have as many rounding errors.
                Filtered::Light(light) => {
                    let unpacked = format.unpack(got);
                    assert!(format.holds(got, &light, 1e-4, 0.0), "{place}: {unpacked:?} instead of {light:?}");
                }
            }
        }
    }
    cases.assert_met(&["no surface", "filtered", "filled", "not listed", "nothing around", "an absent lobe"]);
    cases.assert_met(expected);
}

#[test]
fn svgf_filters_each_lobe_by_its_variance() {
    compare(false, false, 91, &[]);
    compare(true, false, 92, &[]);
}

#[test]
fn svgf_layers_join_in_the_first_iterations() {
    compare(false, true, 93, &["another layer's iteration"]);
    compare(true, true, 94, &["another layer's iteration"]);
}
