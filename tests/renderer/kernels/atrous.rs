//! One iteration of the edge-avoiding filter of frames without history.

use glam::DVec3;

use super::camera::Constants;
use super::edges::{Surface, comparable};
use super::harness::{Buffer, Kernel, Stripe, only_in};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{floats, is_near, rgb};

/// Maximum distance to the centre's plane for the same surface, as a fraction of the distance to the eye.
const REACH: f64 = 0.02;
/// Cubic B-spline at the integers.
const SPLINE: [f64; 5] = [1.0 / 16.0, 1.0 / 4.0, 3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];

/// One iteration over an image.
struct Twin<'a> {
    constants: &'a Constants,
    stripe: &'a Stripe,
    view: usize,
    /// True if pixels may be left to the denoiser.
    sparse: bool,
    step: u32,
    inverse_sigma2: f64,
    /// Number of a layer's iterations that do not compare light. If no pixel is left to the denoiser, `inverse_sigma2`
    /// decides instead.
    blind_iterations: u32,
    guide: &'a [Option<Surface>],
    source: &'a [[f32; 4]],
}

impl Twin<'_> {
    fn has_light(&self, at: usize) -> bool {
        !self.sparse || self.source[at][3] != 0.0
    }

    fn pixel(&self, (x, y): (u32, u32), cases: &mut Cases) -> [f32; 4] {
        let at = self.constants.index(x, y);
        let Some(surface) = &self.guide[at] else {
            cases.meet("no surface");
            return self.source[at];
        };
        // A layer with K iterations takes part in the last K, with steps from 2^(K-1) to 1.
        let iterations = self.constants.foveation.layer_iterations[self.constants.layer((x, y), self.view)];
        let left = self.step.ilog2() + 1;
        if self.sparse && left > iterations {
            cases.meet("another layer's iteration");
            return self.source[at];
        }
        let is_last = self.step == 1;
        let is_empty = !self.has_light(at);
        let compares = !self.sparse || (!is_empty && iterations - left >= self.blind_iterations);
        let inverse_sigma2 = if compares { self.inverse_sigma2 } else { 0.0 };
        let color = comparable(rgb(self.source[at]));
        let reach = surface.reach(&self.constants.eyes[self.view], REACH);
        let (mut sum, mut weight) = (DVec3::ZERO, 0.0);
        for (dx, dy) in (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dx, dy))) {
            let offset = (dx * self.step as i32, dy * self.step as i32);
            let Some(tap) = self.constants.tap((x, y), offset, &self.stripe.valid) else {
                cases.meet("a tap that is not valid");
                continue;
            };
            let Some(other) = self.guide[tap].as_ref().filter(|_| self.has_light(tap)) else { continue };
            let mut similarity = 1.0;
            if (dx, dy) != (0, 0) {
                let difference = (color - comparable(rgb(self.source[tap]))).length_squared() * inverse_sigma2;
                similarity = surface.weight(reach, other, difference);
                if is_empty && is_last && similarity < 1e-6 {
                    cases.meet("a last resort");
                    similarity = 1e-6;
                }
            }
            let k = SPLINE[(dx + 2) as usize] * SPLINE[(dy + 2) as usize] * similarity;
            sum += rgb(self.source[tap]) * k;
            weight += k;
        }
        if !self.sparse {
            cases.meet("filtered");
            return floats(sum / weight, self.source[at][3].into());
        }
        // An empty pixel is filled only if the taps have at least half of the expected samples around it.
        let enough = match is_empty && !is_last {
            true => 0.5 * self.constants.sampling_probability((x, y), self.view),
            false => 0.0,
        };
        if weight <= enough {
            cases.meet("stays empty");
            return [0.0; 4];
        }
        cases.meet(if is_empty { "filled" } else { "filtered" });
        floats(sum / weight, 1.0)
    }
}

/// Runs the last `count` iterations of a filter, each on independent light.
fn compare(sparse: bool, layers: bool, count: u32, seed: u64, expected: &[&'static str]) {
    let mut random = Random::new(seed);
    let mut constants = Constants::new(WIDTH, HEIGHT);
    constants.foveation.layers = layers;
    constants.foveation.sampled_fraction = if sparse { 0.5 } else { 1.0 };
    constants.foveation.layer_iterations = if layers { [count - 2, count - 1, count] } else { [count; 3] };
    let overrides = [("SOBOL", true), ("SPARSE", sparse), ("FOVEATED", layers)];
    let mut cases = Cases::default();
    for (index, stripe) in (0..count).flat_map(|index| stripes().into_iter().map(move |stripe| (index, stripe))) {
        let view = (index % 2) as usize;
        let guide = Wall::new(0.02, 0.6, 0.1).guides(&mut random, &constants, view);
        let texel = |random: &mut Random| match sparse && random.chance(0.6) {
            true => [0.0; 4],
            false => floats(random.color(1.5), 1.0),
        };
        let source: Vec<_> = (0..constants.area()).map(|_| texel(&mut random)).collect();
        let step = 1 << (count - 1 - index);
        let (inverse_sigma2, blind) = if sparse { (3.0f32, 2) } else { (if index < 2 { 0.0 } else { 3.0 }, 0) };
        let before = random.rubbish::<4>(constants.area());
        let outputs = Kernel::new("atrous", &overrides).run(
            &constants,
            stripe.pass(view, [step, inverse_sigma2.to_bits(), blind]),
            WIDTH,
            &[
                ("guide_image", Buffer::image(&only_in(&stripe.valid, WIDTH, &guide))),
                ("source", Buffer::image(&only_in(&stripe.valid, WIDTH, &source))),
                ("filtered", Buffer::image(&before)),
            ],
        );
        let filtered = outputs.get::<[f32; 4]>("filtered");
        let guide: Vec<_> = guide.into_iter().map(Surface::unpack).collect();
        let twin = Twin {
            constants: &constants,
            stripe: &stripe,
            view,
            sparse,
            step,
            inverse_sigma2: inverse_sigma2.into(),
            blind_iterations: blind,
            guide: &guide,
            source: &source,
        };
        for (x, y) in stripe.rows.clone().flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
            let (got, want) = (filtered[constants.index(x, y)], twin.pixel((x, y), &mut cases));
            // Drivers' exponential functions have errors of a few units in the last place of their argument, which is
            // at most 80.
            let near = (0..4).all(|c| is_near(got[c].into(), want[c].into(), 2e-5, 1e-6));
            assert!(near, "({x}, {y}) of iteration {index}, {stripe:?}: {got:?} instead of {want:?}");
        }
    }
    cases.assert_met(&["no surface", "a tap that is not valid", "filtered"]);
    cases.assert_met(expected);
}

#[test]
fn light_is_averaged_along_surfaces() {
    compare(false, false, 3, 71, &[]);
}

#[test]
fn pixels_without_light_wait_for_enough_of_it() {
    compare(true, false, 4, 72, &["filled", "stays empty", "a last resort"]);
}

#[test]
fn layers_take_part_in_the_last_iterations() {
    compare(true, true, 4, 73, &["filled", "stays empty", "a last resort", "another layer's iteration"]);
}
