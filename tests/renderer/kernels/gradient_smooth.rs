//! Smoothing of temporal gradients.

use super::camera::Constants;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{HEIGHT, Random, WIDTH, stripes};

const REACH: i64 = 2;
const UNNOTICED: f64 = 0.01;
const STRENGTH: f64 = 4.0;

/// Returns the fraction of history to drop.
fn expected(gradient: &[[f32; 2]], stripe: &Stripe, (x, y): (u32, u32)) -> f64 {
    let mut sums = [0.0; 2];
    for (dx, dy) in (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy))) {
        let (i, j) = (i64::from(x) + dx, i64::from(y) + dy);
        let valid = i64::from(stripe.valid.start)..i64::from(stripe.valid.end);
        if (0..i64::from(WIDTH)).contains(&i) && valid.contains(&j) {
            let w = (-2.0 * (dx * dx + dy * dy) as f64 / 9.0).exp();
            let tap = gradient[(j * i64::from(WIDTH) + i) as usize];
            sums[0] += w * f64::from(tap[0]);
            sums[1] += w * f64::from(tap[1]);
        }
    }
    let share = if sums[1] > 0.0 { sums[0].abs() / sums[1] } else { 0.0 };
    (STRENGTH * (share - UNNOTICED)).clamp(0.0, 1.0)
}

#[test]
fn history_drops_by_the_fraction_of_changed_light() {
    let mut random = Random::new(61);
    let constants = Constants::new(WIDTH, HEIGHT);
    let mut met = [0; 3];
    for (round, stripe) in stripes().iter().enumerate() {
        // Changes range from unnoticeable ones to those that leave no history; some pixels have no light.
        let most = [0.02, 0.3, 0.6, 1.0][round % 4];
        let gradient: Vec<[f32; 2]> = (0..constants.area())
            .map(|_| {
                let light = if random.chance(0.3) { 0.0 } else { random.within(0.0..9.0) as f32 };
                [light * random.within(-0.2 * most..most) as f32, light]
            })
            .collect();
        let before = vec![-1.0f32; constants.area()];
        let buffers = [("gradient", stripe.valid(WIDTH, &gradient)), ("light_change", Buffer::image(&before))];
        let outputs = Kernel::new("gradient_smooth", &[]).run(&constants, stripe.pass(0, [0; 3]), WIDTH, &buffers);
        let found = outputs.get::<f32>("light_change");
        for (x, y) in stripe.pixels(WIDTH) {
            let (want, got) = (expected(&gradient, stripe, (x, y)), f64::from(found[constants.index(x, y)]));
            assert!((want - got).abs() < 1e-4, "{got} instead of {want} at {x}, {y} of round {round}");
            met[usize::from(want > 0.0) + usize::from(want >= 1.0)] += 1;
        }
    }
    assert!(met.iter().all(|count| *count > 20), "{met:?}");
}
