//! The filter across the seams between stripes.

use super::camera::Constants;
use super::edges::comparable;
use super::filters::Filter;
use super::harness::Kernel;
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{Format, Light, MeanLight};

/// Maximum distance to the centre's plane for the same surface, as a fraction of the distance to the eye.
const SURFACE_REACH: f64 = 0.01;
/// Rows on either side of a seam that are smoothed, and radius of the filter.
const REACH: u32 = 4;
const INVERSE_SIGMA2: f32 = 2.0;

impl Filter<'_, Light> {
    /// Returns the filtered light; none if the pixel does not change.
    fn beside_seam(&self, (x, y): (u32, u32), cases: &mut Cases) -> Option<Light> {
        let Some(surface) = &self.guide[self.constants.index(x, y)] else {
            cases.meet("no surface");
            return None;
        };
        let is_below = self.stripe.rows.start > 0 && y < self.stripe.rows.start + REACH;
        let is_above = self.stripe.rows.end < self.constants.height && y + REACH >= self.stripe.rows.end;
        if !is_below && !is_above {
            cases.meet("far from seams");
            return None;
        }
        cases.meet(if is_below { "below a seam" } else { "above a seam" });
        let centre = &self.source[self.constants.index(x, y)];
        let sum = |light: &Light| light.unmarked().matte + light.unmarked().gloss;
        let color = comparable(sum(centre));
        let reach = surface.reach(&self.constants.eyes[self.view], SURFACE_REACH);
        let (mut matte, mut gloss) = (MeanLight::default(), MeanLight::default());
        let steps = -(REACH as i32)..=REACH as i32;
        for (dx, dy) in steps.clone().flat_map(|dy| steps.clone().map(move |dx| (dx, dy))) {
            let Some(tap) = self.constants.tap((x, y), (dx, dy), &self.stripe.valid) else { continue };
            let Some(other) = &self.guide[tap] else { continue };
            let value = &self.source[tap];
            let apart = (color - comparable(sum(value))).length_squared();
            let near = (-f64::from(dx * dx + dy * dy) / 8.0).exp();
            let w = near * surface.weight(reach, other, apart * f64::from(INVERSE_SIGMA2));
            matte.add(value.matte, w);
            gloss.add(value.gloss, w);
        }
        Some(Light { matte: matte.above(0.0), gloss: gloss.above(0.0), ..*centre })
    }
}

fn compare(gloss: bool, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants::new(WIDTH, HEIGHT);
    let format = Format { gloss };
    let mut cases = Cases::default();
    for (round, stripe) in stripes().iter().enumerate() {
        let view = round % 2;
        let guide = Wall::new(0.01, 0.6, 0.1).guides(&mut random, &constants, view);
        let source: Vec<_> = (0..constants.area())
            .map(|_| {
                let light = random.light(1.5);
                let light = random.with_absent(light);
                format.pack(&Light { variance: glam::DVec2::splat(random.within(0.0..1.0)), ..light })
            })
            .collect();
        let kernel = Kernel::new("seam_filter", &[("HAS_GLOSS", gloss), ("MARKS_ABSENT", true)]);
        let (place, args) = ((&constants, stripe, view), [INVERSE_SIGMA2.to_bits(), 0, 0]);
        let filter =
            Filter::run(&kernel, &mut random, place, args, [&guide, &source], None, |bits| format.unpack(bits));
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let (got, place) = (filter.filtered[at], format!("({x}, {y}) of {stripe:?}"));
            match filter.beside_seam((x, y), &mut cases) {
                None => assert_eq!(got, source[at], "{place}"),
                Some(light) => {
                    let unpacked = format.unpack(got);
                    assert!(format.holds(got, &light, 2e-5, 0.0), "{place}: {unpacked:?} instead of {light:?}");
                }
            }
        }
    }
    cases.assert_met(&["no surface", "far from seams", "below a seam", "above a seam"]);
}

#[test]
fn rows_near_a_seam_are_smoothed() {
    compare(false, 101);
    compare(true, 102);
}
