//! The list of pixels that the filter has to do if the light of others is finished.

use glam::DVec2;

use super::camera::Constants;
use super::filters::UNFINISHED_GROUP;
use super::harness::{Buffer, Kernel};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::mask_compaction::{assert_lists, empty_list};
use super::pack::{FINISHED, Format, Light, NO_NORMAL};

#[test]
fn unfinished_pixels_are_listed_and_others_copied() {
    let mut random = Random::new(101);
    let constants = Constants::new(WIDTH, HEIGHT);
    let mut cases = Cases::default();
    for (stripe, gloss) in stripes().iter().flat_map(|stripe| [(stripe, false), (stripe, true)]) {
        let format = Format { gloss };
        let guide = Wall::new(0.03, 0.6, 0.2).guides(&mut random, &constants, 1);
        let finished: Vec<bool> = guide.iter().map(|_| random.chance(0.7)).collect();
        let light = |is_finished: &bool| {
            let variance = DVec2::splat(if *is_finished { FINISHED } else { 0.25 });
            format.pack(&Light { variance, ..random.light(2.0) })
        };
        let source: Vec<[u32; 4]> = finished.iter().map(light).collect();
        let before = random.rubbish::<4>(constants.area());
        let buffers = [
            ("guide_image", stripe.own(WIDTH, &guide)),
            ("source", stripe.own(WIDTH, &source)),
            ("filtered", Buffer::image(&before)),
            ("history", Buffer::image(&before)),
            ("new_list", Buffer::whole(&empty_list(constants.area()))),
        ];
        let kernel = Kernel::new("select_unfinished", &[("HAS_GLOSS", gloss), ("MARKS_ABSENT", true)]);
        let outputs = kernel.run(&constants, stripe.pass(1, [0; 3]), WIDTH, &buffers);
        let images = ["filtered", "history"].map(|name| outputs.get::<[u32; 4]>(name));
        let mut listed = Vec::new();
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let (case, expected) = match (guide[at][3] == NO_NORMAL, finished[at]) {
                (true, _) => ("no surface", source[at]),
                (false, true) => ("finished", source[at]),
                (false, false) => ("listed", before[at]),
            };
            cases.meet(case);
            listed.extend((case == "listed").then_some(at as u32));
            assert!(images.iter().all(|image| image[at] == expected), "({x}, {y}): {case}");
        }
        assert_lists(&outputs.get::<u32>("new_list"), UNFINISHED_GROUP, listed);
    }
    cases.assert_met(&["no surface", "finished", "listed"]);
}
