//! Mask compaction: the list of pixels to path trace, if others are left to the denoiser.

use super::camera::Constants;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, stripes};
use super::pack::{Counts, MIXED, NO_NORMAL};

pub use diptych::graph::LIST_GROUP;

/// Returns an empty list of holes: its length, the three sizes of the dispatch over it, and room for `area` pixels.
pub fn empty_list(area: usize) -> Vec<u32> {
    [0, 0, 1, 1].into_iter().chain(std::iter::repeat_n(0xdead_beef, area)).collect()
}

/// Returns a list of these pixels, for a dispatch of workgroups that handle `group` of them.
pub fn list_of(pixels: &[u32], group: u32) -> Vec<u32> {
    let count = pixels.len() as u32;
    [count, count.div_ceil(group), 1, 1].into_iter().chain(pixels.iter().copied()).collect()
}

/// Asserts that a list contains these pixels, in any order, and dispatches enough workgroups, which handle `group` each.
#[track_caller]
pub fn assert_lists(list: &[u32], group: u32, mut pixels: Vec<u32>) {
    let count = pixels.len();
    assert_eq!(list[0] as usize, count, "pixels that are counted");
    assert_eq!(list[1..4], [(count as u32).div_ceil(group), 1, 1], "workgroups for {count} pixels");
    let mut listed = list[4..4 + count].to_vec();
    listed.sort_unstable();
    pixels.sort_unstable();
    assert_eq!(listed, pixels);
    assert!(list[4 + count..].iter().all(|&slot| slot == 0xdead_beef), "slots behind the list were written");
}

struct Selected {
    radiance: Vec<[u32; 4]>,
    tally: Vec<u32>,
    list: Vec<u32>,
}

fn select(
    constants: &Constants,
    stripe: &Stripe,
    view: usize,
    [hit, guide, radiance]: [&[[u32; 4]]; 3],
    tally: &[u32],
) -> Selected {
    let overrides = [("SOBOL", true), ("SPARSE", true), ("FOVEATED", constants.foveation.layers)];
    let width = constants.width;
    let buffers = [
        ("hit_image", stripe.own(width, hit)),
        ("guide_image", stripe.own(width, guide)),
        ("radiance_image", Buffer::image(radiance)),
        ("tally_image", Buffer::image(tally)),
        ("new_list", Buffer::whole(&empty_list(constants.area()))),
    ];
    let outputs = Kernel::new("mask_compaction", &overrides).run(constants, stripe.pass(view, [0; 3]), width, &buffers);
    Selected {
        radiance: outputs.get("radiance_image"),
        tally: outputs.get("tally_image"),
        list: outputs.get("new_list"),
    }
}

fn compare(layers: bool, view: usize, width: u32, seed: u64) {
    let mut random = Random::new(seed);
    let mut constants = Constants::new(width, HEIGHT);
    constants.foveation.layers = layers;
    constants.foveation.sampled_fraction = 0.6;
    constants.foveation.mask_turn = random.bits();
    let area = constants.area();
    let hit: Vec<[u32; 4]> = (0..area).map(|_| [1, 2, 3, 9 | random.pick(&[0, 0, MIXED])]).collect();
    let guide: Vec<[u32; 4]> = (0..area).map(|_| [0, 0, 0, random.pick(&[NO_NORMAL, 5, 6])]).collect();
    let tally: Vec<u32> = (0..area).map(|_| random.bits() & 0x0fff_ffff).collect();
    let before = random.rubbish::<4>(area);
    let mut cases = Cases::default();
    for stripe in stripes() {
        let selected = select(&constants, &stripe, view, [&hit, &guide, &before], &tally);
        let mut wanted = Vec::new();
        for (x, y) in stripe.pixels(width) {
            let at = constants.index(x, y);
            let is_rim = guide[at][3] == NO_NORMAL && hit[at][3] & MIXED != 0;
            let why = match (constants.is_sampled((x, y), view), is_rim) {
                (false, false) => {
                    cases.meet("left to the denoiser");
                    Counts::SKIPPED
                }
                (sampled, _) => {
                    cases.meet(if sampled { "sampled" } else { "rim" });
                    wanted.push(at as u32);
                    0
                }
            };
            assert_eq!(Counts::unpack(selected.tally[at]), Counts { why, ..Counts::unpack(tally[at]) }, "({x}, {y})");
            assert_eq!(selected.radiance[at], [0; 4], "({x}, {y})");
        }
        assert_lists(&selected.list, LIST_GROUP, wanted);
    }
    cases.assert_met(&["left to the denoiser", "sampled", "rim"]);
}

#[test]
fn mask_lists_the_sampled_fraction_of_pixels() {
    // Columns need more than 8 bits, and pixels more than a few workgroups.
    compare(false, 0, 300, 41);
}

#[test]
fn mask_lists_fewer_pixels_away_from_the_gaze() {
    compare(true, 0, WIDTH, 42);
    compare(true, 1, WIDTH, 43);
}

/// Owen scrambling on the Z curve stratifies the mask in all aligned blocks.
#[test]
fn mask_lists_the_fraction_in_every_aligned_block() {
    let mut constants = Constants::new(64, 32);
    constants.foveation.sampled_fraction = 0.25;
    let (zero, surface) = (vec![[0; 4]; constants.area()], vec![[0, 0, 0, 5]; constants.area()]);
    let whole = Stripe { rows: 0..32, valid: 0..32 };
    let selected = select(&constants, &whole, 0, [&zero, &surface, &zero], &vec![0; constants.area()]);
    for edge in [2, 4, 8, 16, 32] {
        let mut counts = vec![0; ((64 / edge) * (32 / edge)) as usize];
        for pixel in &selected.list[4..4 + selected.list[0] as usize] {
            let (x, y) = (pixel % 64, pixel / 64);
            counts[(y / edge * (64 / edge) + x / edge) as usize] += 1;
        }
        assert!(counts.iter().all(|&n| n == edge * edge / 4), "blocks of {edge} x {edge} pixels: {counts:?}");
    }
}

#[test]
fn pixels_are_dispatched_in_whole_groups() {
    for count in [1, 32, 33, 64, 65] {
        let constants = Constants::new(count, 1);
        let (zero, tally) = (vec![[0; 4]; count as usize], vec![0; count as usize]);
        let stripe = Stripe { rows: 0..1, valid: 0..1 };
        let selected = select(&constants, &stripe, 0, [&zero, &zero, &zero], &tally);
        assert_lists(&selected.list, LIST_GROUP, (0..count).collect());
    }
}
