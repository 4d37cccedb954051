//! Light that the right eye takes over after the left eye's filter.

use glam::{DVec2, DVec3};

use super::twin::{Fate, Twin};
use super::{PLAIN, Pixel, inputs};
use crate::kernels::camera::Constants;
use crate::kernels::harness::{Buffer, Kernel};
use crate::kernels::inputs::{Cases, HEIGHT, Random, WIDTH, stripes};
use crate::kernels::pack::{Albedo, Counts, FINISHED, Format, Light, MISSING};

/// Returns true if light is absent in a channel that the albedo has.
fn lacks(light: &Light, albedo: &Albedo, gloss: bool) -> bool {
    let all = Light { matte: DVec3::ONE, gloss: DVec3::ONE, ..*light }.reflected_by(albedo);
    let lacks = |light: DVec3, all: DVec3| (0..3).any(|c| light[c] < 0.0 && all[c] >= 0.0);
    lacks(light.matte, all.matte) || (gloss && lacks(light.gloss, all.gloss))
}

fn compare([gloss, layers]: [bool; 2], seed: u64) {
    let mut random = Random::new(seed);
    let mut constants = Constants::new(WIDTH, HEIGHT);
    constants.foveation.layers = layers;
    let format = Format { gloss };
    let flags = [("HAS_GLOSS", gloss), ("FOVEATED", layers), ("SPARSE", layers), ("ACCEPTS_MIXED", true)];
    let overrides = [&PLAIN[..], &flags].concat();
    let mut cases = Cases::default();
    for (round, stripe) in stripes().iter().enumerate() {
        let eyes = inputs(&mut random, &constants, format, false);
        let left_light: Vec<_> = (0..constants.area())
            .map(|_| {
                let known = DVec2::new(random.within(0.0..0.4), random.within(0.0..0.1));
                let variance = if random.chance(0.2) { DVec2::splat(MISSING) } else { known };
                let light = random.light(2.0);
                format.pack(&Light { variance, ..random.with_absent(light) })
            })
            .collect();
        // Some surfaces are black in a channel or in a lobe.
        let albedo: Vec<_> = (0..constants.area())
            .map(|_| {
                let color = |random: &mut Random| {
                    let bright = DVec3::splat(0.5);
                    random.pick(&[bright, bright, bright.with_x(0.0), bright.with_z(0.0), DVec3::ZERO])
                };
                let matte = color(&mut random);
                format.pack_albedo(&Albedo { all: matte + color(&mut random), matte, roughness: 0.5 })
            })
            .collect();
        let light = |at: usize| Some(format.unpack(left_light[at])).filter(|light| light.variance.x != MISSING);
        let pixel = |view, at| eyes.pixel(&constants, view, at, light(at));
        let left: Vec<Pixel> = (0..constants.area()).map(|at| pixel(0, at)).collect();
        let twin = Twin { constants: &constants, sparse: false, accepts_mixed: true, left: &left };
        let tally: Vec<u32> = (0..constants.area())
            .map(|_| {
                let why = random.pick(&[0, 0, 0, 0, 2, 6, Counts::SKIPPED]);
                Counts { why, ..Counts::unpack(random.bits()) }.pack()
            })
            .collect();
        let source: Vec<_> = (0..constants.area()).map(|_| format.pack(&random.light(2.0))).collect();
        let image = |pixels: &[[u32; 4]]| stripe.own(constants.width, pixels);
        let buffers = [
            ("left_hit", image(&eyes.hit[0])),
            ("left_guide", image(&eyes.guide[0])),
            ("left_light", image(&left_light)),
            ("hit_image", image(&eyes.hit[1])),
            ("guide_image", image(&eyes.guide[1])),
            ("albedo_image", image(&albedo)),
            ("tally_image", Buffer::image(&tally)),
            ("source", image(&source)),
            ("filtered", Buffer::image(&random.rubbish::<4>(constants.area()))),
        ];
        let kernel = Kernel::new("reproject_filtered", &overrides);
        let outputs = kernel.run(&constants, stripe.pass(1, [0; 3]), constants.width, &buffers);
        let filtered = outputs.get::<[u32; 4]>("filtered");
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let place = format!("({x}, {y}) of round {round}");
            let why = Counts::unpack(tally[at]).why;
            let is_traced = why != 0 && why != Counts::SKIPPED;
            match twin.fate((x, y), &pixel(1, at), &mut Cases::default()) {
                Fate::Gathered(light) if !is_traced && lacks(&light, &format.unpack_albedo(albedo[at]), gloss) => {
                    cases.meet("left to the filter");
                    assert_eq!(filtered[at], source[at], "{place}");
                }
                Fate::Gathered(light) if !is_traced => {
                    cases.meet(if why == 0 { "taken over" } else { "taken over instead of filled" });
                    let want = Light { variance: DVec2::splat(FINISHED), ..light };
                    let unpacked = format.unpack(filtered[at]);
                    let holds = format.holds(filtered[at], &want, 2e-4, 0.0);
                    assert!(holds, "{place}: {unpacked:?} instead of {want:?}");
                }
                fate => {
                    cases.meet(match fate {
                        Fate::Gathered(_) => "traced",
                        Fate::Sky => "sky",
                        Fate::Hole(_) | Fate::LeftToFilter => "not seen by the left eye",
                    });
                    assert_eq!(filtered[at], source[at], "{place}: {fate:?}");
                }
            }
        }
    }
    cases.assert_met(&[
        "left to the filter",
        "taken over",
        "taken over instead of filled",
        "traced",
        "sky",
        "not seen by the left eye",
    ]);
}

#[test]
fn reproject_reuses_filtered_light_in_untraced_pixels() {
    compare([false; 2], 161);
    compare([true, false], 162);
}

#[test]
fn outer_layers_reuse_light_of_more_unlike_surfaces() {
    compare([false, true], 163);
    compare([true; 2], 164);
}
