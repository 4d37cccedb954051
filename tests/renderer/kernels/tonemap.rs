//! Remodulation and display encoding of frames without history.

use glam::DVec3;

use super::camera::{Constants, STORAGE_SCALE};
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, stripes};
use super::pack::{Counts, floats, is_finite, is_near, rgb};

/// Maximum error of a display level before rounding.
const LEVEL_ERROR: f64 = 0.51;

/// Returns display levels of linear light, 0 to 255, not rounded: exposure, c / (1 + c), and sRGB's transfer function.
pub fn display_levels(color: DVec3, exposure: f64) -> DVec3 {
    let exposed = color.clamp(DVec3::ZERO, DVec3::splat(1e18)) * exposure;
    (exposed / (1.0 + exposed))
        .map(|c| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 } * 255.0)
}

/// Returns true if a pixel of the display image shows these levels and is opaque.
pub fn shows(code: u32, levels: DVec3) -> bool {
    let [r, g, b, a] = code.to_le_bytes().map(f64::from);
    a == 255.0 && (DVec3::new(r, g, b) - levels).abs().max_element() <= LEVEL_ERROR
}

#[test]
fn light_is_remodulated_and_encoded() {
    let mut random = Random::new(21);
    let constants = Constants { exposure: 0.7, ..Constants::new(WIDTH, HEIGHT) };
    let area = constants.area();
    let mut radiance: Vec<_> = (0..area).map(|_| floats(random.color(3.0), 1.0)).collect();
    let albedo: Vec<_> = (0..area).map(|_| floats(random.color(1.0), 0.5)).collect();
    let mut emission: Vec<_> = (0..area).map(|_| floats(random.color(0.01), 0.0)).collect();
    for at in 0..area {
        match random.bits() % 12 {
            0 => radiance[at][1] = f32::INFINITY,
            1 => emission[at][2] = f32::NAN,
            2 => (radiance[at], emission[at]) = ([0.0; 4], floats(random.color(0.002), 0.0)),
            3 => radiance[at][0] = -1.0,
            4 => radiance[at][0] = 1e30,
            _ => {}
        }
    }
    let tally: Vec<u32> = (0..area).map(|_| random.pick(&[5, 0x0ff0_0003, 0x10f0_0001, 0x7000_0000])).collect();
    let (linear_before, display_before) = (random.rubbish::<4>(area), random.rubbish::<1>(area));
    let mut cases = Cases::default();
    for stripe in stripes() {
        let buffers = [
            ("radiance", stripe.own(WIDTH, &radiance)),
            ("albedo_image", stripe.own(WIDTH, &albedo)),
            ("emission_image", stripe.own(WIDTH, &emission)),
            ("linear", Buffer::image(&linear_before)),
            ("display", Buffer::image(&display_before)),
            ("tally_image", Buffer::image(&tally)),
        ];
        let outputs = Kernel::new("tonemap", &[]).run(&constants, stripe.pass(1, [0; 3]), WIDTH, &buffers);
        let (linear, display) = (outputs.get::<[f32; 4]>("linear"), outputs.get::<u32>("display"));
        let counted = outputs.get::<u32>("tally_image");
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let light = rgb(radiance[at]) / f64::from(STORAGE_SCALE) * rgb(albedo[at]) + rgb(emission[at]);
            let (color, dropped) = if is_finite(light) { (light, 0) } else { (DVec3::ZERO, 1) };
            let counts = Counts::unpack(tally[at]).with_dropped(dropped);
            let got = rgb(linear[at]);
            // Negative light may cancel in the sum.
            let near = (0..3).all(|c| is_near(got[c], color[c], 1e-6, 1e-6));
            assert!(near && linear[at][3] == 1.0, "({x}, {y}): {:?} instead of {color}", linear[at]);
            let levels = display_levels(color, constants.exposure.into());
            assert!(shows(display[at], levels), "({x}, {y}): {:08x} instead of {levels}", display[at]);
            assert_eq!(Counts::unpack(counted[at]), counts, "({x}, {y})");
            let met = [
                ("dropped", dropped > 0),
                ("kept", dropped == 0),
                ("as many dropped as can be counted", dropped > 0 && Counts::unpack(tally[at]).dropped == 255),
                ("below black", color.min_element() < 0.0),
                ("dark", levels.max_element() < 10.0),
                ("white", levels.max_element() > 254.9),
            ];
            met.iter().filter(|(_, is_met)| *is_met).for_each(|(case, _)| cases.meet(case));
        }
    }
    cases.assert_met(&["dropped", "kept", "as many dropped as can be counted", "below black", "dark", "white"]);
}
