//! Blur of visual-polar images.

use std::f64::consts::TAU;

use diptych::layout::PassConstants;
use glam::DVec3;

use super::{FOVEA_DEG, GAZES, Polar};
use crate::kernels::harness::{Buffer, Kernel, Stripe};
use crate::kernels::inputs::{Cases, Random};
use crate::kernels::pack::rgb;

/// Returns the deviation of the Gaussian of Koskela et al. 2019, section 3, along an axis of the image, in pixels.
fn deviation(polar: &Polar, row: u32, along_columns: bool) -> f64 {
    let e = polar.eccentricity(f64::from(row) + 0.5);
    let share = ((e - FOVEA_DEG) / (30.0 - FOVEA_DEG)).clamp(0.0, 1.0);
    // 6.8 of the eye's 1440 rows.
    let angle = share * 2.0 * 6.8 / 1440.0 * f64::from(polar.eye.tan_half.y);
    let step = 1e-3;
    let rows_per_degree = (polar.row_of(e + step) - polar.row_of(e - step)) / (2.0 * step);
    let columns_per_radian = f64::from(polar.length(row)) / (TAU * e.to_radians().sin());
    angle * if along_columns { columns_per_radian } else { rows_per_degree.to_degrees() }
}

/// Returns the mean around a pixel, over at most `most` pixels to each side; none if rounding decides.
fn blurred(
    polar: &Polar,
    stripe: &Stripe,
    (column, row): (u32, u32),
    (along_columns, most, deviation): (bool, u32, f64),
    source: &[[f32; 4]],
    cases: &mut Cases,
) -> Option<DVec3> {
    let own = rgb(source[(row * polar.columns + column) as usize]);
    let reach = 2.5 * deviation;
    if (deviation - 0.3).abs() < 3e-3 || ((reach - reach.round()).abs() < 0.03 && reach < f64::from(most)) {
        return None;
    }
    if deviation < 0.3 {
        cases.meet("as it was");
        return Some(own);
    }
    let reach = (reach.ceil() as i32).min(most as i32);
    cases.meet(if reach == most as i32 { "as far as rows are there" } else { "blurred" });
    let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
    for i in -reach..=reach {
        let ring = if along_columns { Some(row) } else { row.checked_add_signed(i) };
        let Some(ring) = ring.filter(|ring| stripe.valid.contains(ring)) else {
            cases.meet("rows that are not there");
            continue;
        };
        let aside = if along_columns { i } else { 0 };
        let turn = (f64::from(column) + f64::from(aside) + 0.5) / f64::from(polar.length(row));
        let there = (turn.rem_euclid(1.0) * f64::from(polar.length(ring))) as u32;
        let weight = (-0.5 * (f64::from(i) / deviation).powi(2)).exp();
        sum += rgb(source[(ring * polar.columns + there) as usize]) * weight;
        weights += weight;
    }
    Some(sum / weights)
}

#[test]
fn polar_images_are_blurred_as_far_as_acuity_allows() {
    let mut random = Random::new(182);
    let mut cases = Cases::default();
    let polar = Polar { columns: 856, rows: 480, fovea_rows: 480.0 * 0.21, ..Polar::new(GAZES[1]) };
    let source = polar.image(|_, _| {
        let color = DVec3::from_array(std::array::from_fn(|_| random.within(0.0..1.0)));
        color.as_vec3().extend(9.0).to_array()
    });
    let before = random.rubbish::<4>(source.len());
    for (along_columns, most, rows, margin) in [
        (true, 20, 0..480u32, 0),
        (true, 3, 300..340, 0),
        (false, 20, 0..480, 0),
        (false, 20, 250..300, 20),
        (false, 20, 330..371, 2),
        (false, 3, 400..480, 3),
    ] {
        let stripe = Stripe { valid: rows.start.saturating_sub(margin)..(rows.end + margin).min(480), rows };
        let (width, height) = (polar.columns, polar.rows);
        let pass = PassConstants { width, height, ..stripe.pass(1, [u32::from(!along_columns), most, 0]) };
        let buffers = [("source", stripe.valid(width, &source)), ("blurred", Buffer::image(&before))];
        let outputs = Kernel::new("visual_polar_blur", &[]).run_rows(&polar.frame(), pass, &buffers);
        let found = outputs.get::<[u32; 4]>("blurred");
        for (column, row) in stripe.pixels(width) {
            let at = (row * width + column) as usize;
            if column >= polar.length(row) {
                assert_eq!(found[at], before[at], "({column}, {row}) is no pixel");
                continue;
            }
            if random.chance(0.9) {
                continue;
            }
            let mode = (along_columns, most, deviation(&polar, row, along_columns));
            let Some(want) = blurred(&polar, &stripe, (column, row), mode, &source, &mut cases) else { continue };
            // The fit of eccentricities has an error of 0.03 degrees, so deviations have errors of about 0.3 %.
            let off = (rgb(found[at].map(f32::from_bits)) - want).abs().max_element();
            assert!(off < 4e-3, "({column}, {row}) of {stripe:?}: off by {off}");
        }
    }
    cases.assert_met(&["as it was", "blurred", "as far as rows are there", "rows that are not there"]);
}
