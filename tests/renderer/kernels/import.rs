//! Import of other renderers' frames.

use glam::DVec3;

use super::camera::{Constants, STORAGE_SCALE};
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, stripes};
use super::pack::{ABSENT, MATERIAL_MASK, NO_NORMAL, SAMPLED, is_near, rgb, unpack_normal};

/// A pixel of a frame.
struct Pixel {
    color: DVec3,
    emission: DVec3,
    albedo: DVec3,
    normal: DVec3,
    position: DVec3,
    last: DVec3,
}

impl Pixel {
    fn new(random: &mut Random) -> Self {
        let mut vector = |most: f64| DVec3::from_array(std::array::from_fn(|_| random.within(-most..most)));
        let (mut normal, mut position, mut last) = (vector(3.0), vector(5.0), vector(5.0));
        let mut albedo = vector(1.0).abs();
        let (mut emission, color) = (DVec3::ZERO, random.color(2.0));
        match random.bits() % 8 {
            0 => normal = DVec3::ZERO,
            1 => position.y = f64::INFINITY,
            2 => last.x = f64::NAN,
            3 => albedo.y = 0.0,
            4 => emission = 0.5 * color,
            // Rounding may leave more emission than light.
            5 => emission = color * 1.001,
            _ => {}
        }
        Self { color, emission, albedo, normal, position, last }
    }

    fn is_surface(&self) -> bool {
        self.normal != DVec3::ZERO && self.position.is_finite()
    }
}

fn compare(is_animated: bool, seed: u64) {
    let mut random = Random::new(seed);
    let constants = Constants::new(WIDTH, HEIGHT);
    let pixels: Vec<_> = (0..constants.area()).map(|_| Pixel::new(&mut random)).collect();
    let of = |value: fn(&Pixel) -> DVec3| {
        pixels.iter().map(|p| value(p).as_vec3().extend(f32::NAN).to_array()).collect::<Vec<_>>()
    };
    let outputs =
        ["hit_image", "guide_image", "albedo_image", "emission_image", "radiance_image", "last_surface_image"];
    let mut cases = Cases::default();
    for stripe in stripes() {
        let mut buffers = vec![
            ("imported_color", stripe.own(WIDTH, &of(|p| p.color))),
            ("imported_emission", stripe.own(WIDTH, &of(|p| p.emission))),
            ("imported_albedo", stripe.own(WIDTH, &of(|p| p.albedo))),
            ("imported_normal", stripe.own(WIDTH, &of(|p| p.normal))),
            ("imported_position", stripe.own(WIDTH, &of(|p| p.position))),
            ("imported_last_position", stripe.own(WIDTH, &of(|p| p.last))),
            ("tally_image", Buffer::image(&random.rubbish::<1>(constants.area()))),
        ];
        let rubbish = random.rubbish::<4>(constants.area());
        buffers.extend(outputs.map(|name| (name, Buffer::image(&rubbish))));
        let kernel = Kernel::new("import", &[("MARKS_ABSENT", true), ("HAS_MOTION", is_animated)]);
        let found = kernel.run(&constants, stripe.pass(1, [0; 3]), WIDTH, &buffers);
        let [hit, guide, last] =
            ["hit_image", "guide_image", "last_surface_image"].map(|name| found.get::<[u32; 4]>(name));
        let [albedo, emission, radiance] =
            ["albedo_image", "emission_image", "radiance_image"].map(|name| found.get::<[f32; 4]>(name));
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let pixel = &pixels[at];
            let is_surface = pixel.is_surface();
            let is_black = |c: usize| !is_surface || pixel.albedo[c] < 1e-6;
            let normal = pixel.normal.normalize_or(DVec3::Z);
            let near = |found: f64, expected: f64| is_near(found, expected, 1e-5, 1e-6);
            for c in 0..3 {
                let light = f64::from(STORAGE_SCALE) * (pixel.color[c] - pixel.emission[c]).max(0.0);
                let expected = match is_black(c) {
                    true => [ABSENT, 0.0, pixel.color[c]],
                    false => [light / pixel.albedo[c], pixel.albedo[c], pixel.emission[c]],
                };
                let got = [radiance[at], albedo[at], emission[at]].map(|image| rgb(image)[c]);
                assert!((0..3).all(|i| near(got[i], expected[i])), "({x}, {y}): {got:?}, not {expected:?}");
            }
            let distance = pixel.position.distance(constants.eyes[1].origin.as_dvec3());
            assert!(near(emission[at][3].into(), if is_surface { distance } else { 0.0 }), "({x}, {y})");
            assert_eq!((radiance[at][3].to_bits(), found.get::<u32>("tally_image")[at]), (SAMPLED, 0));
            let is_at = |words: [u32; 4], position: DVec3, normal: DVec3| {
                let same = (0..3).all(|c| words[c] == (position[c] as f32).to_bits());
                same && words[3] != NO_NORMAL && unpack_normal(words[3]).dot(normal) > 0.9999
            };
            if is_surface {
                assert!(is_at(guide[at], pixel.position, normal) && hit[at][3] == 0, "({x}, {y}): {:x?}", guide[at]);
            } else {
                assert!(guide[at][3] == NO_NORMAL && hit[at][3] == MATERIAL_MASK, "({x}, {y}): {:x?}", guide[at]);
            }
            let was_there = pixel.last.is_finite();
            match (is_animated, is_surface, was_there) {
                (false, ..) => assert_eq!(last[at], rubbish[at]),
                (true, false, _) => assert_eq!(last[at][3], NO_NORMAL),
                (true, true, true) => assert!(is_at(last[at], pixel.last, normal)),
                (true, true, false) => assert!(is_at(last[at], pixel.position, -normal)),
            }
            cases.meet(match (is_surface, was_there, (0..3).any(is_black)) {
                (false, ..) => "sky",
                (true, false, _) => "new surface",
                (true, true, true) => "black channel",
                (true, true, false) => "surface",
            });
        }
    }
    cases.assert_met(&["sky", "new surface", "black channel", "surface"]);
}

#[test]
fn import_demodulates_light_of_other_renderers() {
    compare(false, 61);
}

#[test]
fn import_brings_surfaces_of_the_previous_frame() {
    compare(true, 62);
}
