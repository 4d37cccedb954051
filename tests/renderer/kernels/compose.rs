//! Remodulation: multiplies demodulated illumination by albedo.

use glam::{DVec2, DVec3};

use super::camera::{Constants, STORAGE_SCALE};
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, stripes};
use super::pack::{Albedo, Format, Light, floats, is_finite, is_near, rgb};

/// Value in place of a depth: the pixel's colour was not finite.
const DROPPED: f64 = -1.0;

/// Returns colour and depth of a pixel.
fn twin(light: &Light, albedo: &Albedo, emission: DVec3, depth: f64, cases: &mut Cases) -> (DVec3, f64) {
    if light.unmarked() != *light {
        cases.meet("absent light");
    }
    let light = light.unmarked();
    let gloss = (albedo.all - albedo.matte).max(DVec3::ZERO);
    let radiance = (light.matte * albedo.matte + light.gloss * gloss) / f64::from(STORAGE_SCALE);
    let color = radiance + emission;
    if !is_finite(color) {
        cases.meet("dropped");
        return (DVec3::ZERO, DROPPED);
    }
    cases.meet(if depth > 0.0 { "surface" } else { "sky" });
    (color, depth)
}

fn compare(gloss: bool, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants::new(WIDTH, HEIGHT);
    let format = Format { gloss };
    let (mut radiance, mut albedo, mut emission) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..constants.area() {
        let mut light = random.light(3.0);
        let mut emitted = random.color(0.5);
        match random.bits() % 60 {
            0 => light.matte.y = f64::INFINITY,
            1 => emitted.x = f64::NAN,
            2 => (light.matte.z, emitted.z) = (3e38, 3e38),
            _ => light = random.with_absent(light),
        }
        let matte = DVec3::from_array(std::array::from_fn(|_| random.within(0.0..1.0)));
        let all = matte + DVec3::from_array(std::array::from_fn(|_| random.within(0.0..0.3)));
        let mut bits = format.pack_sampled(&Light { variance: DVec2::ZERO, ..light });
        if gloss && !light.matte.is_finite() {
            // Packing clamps half floats, but this one is infinite.
            bits[0] = 0x7c00_0000;
        }
        radiance.push(bits);
        albedo.push(format.pack_albedo(&Albedo { all, matte, roughness: 0.3 }));
        let depth = if random.chance(0.2) { 0.0 } else { random.within(1.0..9.0) };
        emission.push(floats(emitted, depth));
    }
    let before = random.rubbish::<4>(constants.area());
    let mut cases = Cases::default();
    for stripe in stripes() {
        let buffers = [
            ("radiance", stripe.own(WIDTH, &radiance)),
            ("albedo_image", stripe.own(WIDTH, &albedo)),
            ("emission_image", stripe.own(WIDTH, &emission)),
            ("composed", Buffer::image(&before)),
        ];
        let kernel = Kernel::new("compose", &[("HAS_GLOSS", gloss), ("MARKS_ABSENT", true)]);
        let outputs = kernel.run(&constants, stripe.pass(0, [0; 3]), WIDTH, &buffers);
        let composed = outputs.get::<[f32; 4]>("composed");
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let (light, reflected) = (format.unpack(radiance[at]), format.unpack_albedo(albedo[at]));
            let depth = f64::from(emission[at][3]);
            let (color, depth) = twin(&light, &reflected, rgb(emission[at]), depth, &mut cases);
            let got = rgb(composed[at]);
            // A result has about a dozen roundings of floats.
            let near = (0..3).all(|c| is_near(got[c], color[c], 1e-6, 0.0));
            assert!(near && f64::from(composed[at][3]) == depth, "({x}, {y}): {:?}, not {color} {depth}", composed[at]);
        }
    }
    cases.assert_met(&["dropped", "surface", "sky", "absent light"]);
}

#[test]
fn compose_multiplies_radiance_by_albedo() {
    compare(false, 11);
}

#[test]
fn compose_multiplies_specular_by_its_own_albedo() {
    compare(true, 12);
}
