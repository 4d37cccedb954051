//! Reprojection of the left eye's light into the right eye, and the compacted list of holes.

mod filtered;
mod twin;

use glam::{DVec2, DVec3, Vec2};

use self::twin::{Fate, Pixel, Twin, Why};
use super::camera::{Constants, Eye};
use super::edges::Surface;
use super::harness::{Buffer, Kernel, Outputs, Override, Stripe};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::mask_compaction::{LIST_GROUP, assert_lists, empty_list, list_of};
use super::pack::{
    Counts, Format, Light, MATERIAL_MASK, MIRRORED, MIXED, UNKNOWN, VIEW_DEPENDENT, pack_guide, position,
};

struct Eyes {
    hit: [Vec<[u32; 4]>; 2],
    guide: [Vec<[u32; 4]>; 2],
    left_radiance: Vec<[u32; 4]>,
}

impl Eyes {
    fn pixel(&self, constants: &Constants, view: usize, at: usize, light: Option<Light>) -> Pixel {
        let hit = self.hit[view][at][3];
        let (eye, (x, y)) = (&constants.eyes[view], (at as u32 % constants.width, at as u32 / constants.width));
        let surface = Surface::unpack(self.guide[view][at]);
        let length = f64::from(f32::from_bits(self.hit[view][at][1]));
        let mirrored = eye.origin.as_dvec3() + eye.ray(constants.through(x, y), constants.size()) * length;
        let own = surface.map_or(DVec3::ZERO, |surface| surface.position);
        Pixel {
            surface,
            image: if hit & MIRRORED != 0 { mirrored } else { own },
            is_mixed: hit & MIXED != 0,
            is_view_dependent: hit & VIEW_DEPENDENT != 0,
            material: hit & MATERIAL_MASK,
            light,
        }
    }
}

fn inputs(random: &mut Random, constants: &Constants, format: Format, sparse: bool) -> Eyes {
    // Bumps and tilts are near the thresholds. That of bumps is larger in outer layers.
    let wall = Wall::new(if constants.foveation.layers { 0.008 } else { 0.003 }, 0.32, 0.05);
    let area = constants.area();
    let mut hit = || -> Vec<[u32; 4]> {
        let flags = |random: &mut Random| match random.bits() % 20 {
            0 => MIXED,
            1 => VIEW_DEPENDENT,
            // Bits of the roughness.
            2..6 => 0x3f00_0000,
            _ => 0,
        };
        let materials = [7, 7, 7, 8, 7 | MIRRORED, 7 | MIRRORED];
        (0..area).map(|_| [1, 2, 3, random.pick(&materials) | flags(random)]).collect()
    };
    let mut hit = [hit(), hit()];
    let mut guide = [0, 1].map(|view| wall.guides(random, constants, view));
    let left = constants.eyes[0];
    for bits in &mut guide[1] {
        if random.chance(0.03) {
            let behind = left.origin.as_dvec3() - left.forward.as_dvec3() * random.within(0.1..2.0);
            *bits = pack_guide(behind + DVec3::Y, random.tilted(wall.normal, 0.1));
        }
    }
    for view in [0, 1] {
        let eye = constants.eyes[view].origin.as_dvec3();
        for (hit, guide) in hit[view].iter_mut().zip(&guide[view]) {
            let bent = if random.chance(0.3) { random.within(0.98..1.02) } else { 1.0 };
            hit[1] = ((position(*guide).distance(eye) * bent) as f32).to_bits();
        }
    }
    let mut radiance = || match sparse && random.chance(0.4) {
        true => [0; 4],
        false => {
            let variance = DVec2::new(random.within(0.0..0.4), random.within(0.0..0.1));
            let light = random.light(2.0);
            let light = Light { variance, ..random.with_absent(light) };
            if random.chance(0.3) { format.pack_sampled(&light) } else { format.pack_sampled_with(&light) }
        }
    };
    Eyes { hit, guide, left_radiance: (0..area).map(|_| radiance()).collect() }
}

/// Overrides of every frame.
const PLAIN: [Override; 3] = [("MARKS_ABSENT", true), ("SOBOL", true), ("HAS_MIRRORS", true)];

/// Reprojects the left eye's light or, with listed holes, takes over that of a partner that shows what the left eye does.
fn run(
    constants: &Constants,
    stripe: &Stripe,
    overrides: &[Override],
    eyes: &Eyes,
    before: &[[u32; 4]],
    tally: &[u32],
    listed: Option<&[u32]>,
) -> Outputs {
    let image = |pixels: &[[u32; 4]]| stripe.own(constants.width, pixels);
    let mut buffers = vec![
        ("left_hit", image(&eyes.hit[0])),
        ("left_guide", image(&eyes.guide[0])),
        ("left_radiance", image(&eyes.left_radiance)),
        ("hit_image", image(&eyes.hit[1])),
        ("guide_image", image(&eyes.guide[1])),
        ("radiance_image", Buffer::image(before)),
        ("tally_image", Buffer::image(tally)),
        ("new_list", Buffer::whole(&empty_list(constants.area()))),
    ];
    let Some(listed) = listed else {
        let kernel = Kernel::new("reproject", overrides);
        return kernel.run(constants, stripe.pass(1, [0; 3]), constants.width, &buffers);
    };
    buffers.push(("listed", Buffer::whole(&list_of(listed, LIST_GROUP))));
    let groups = [(listed.len() as u32).div_ceil(LIST_GROUP), 1];
    Kernel::new("share_holes", overrides).run_groups(constants, stripe.pass(1, [0, 1, 0]), groups, &buffers)
}

fn compare(
    [gloss, sparse, accepts_mixed]: [bool; 3],
    adjust: impl Fn(&mut Constants),
    seed: u64,
    expected: &[&'static str],
) {
    let mut random = Random::new(seed);
    let mut constants = Constants::new(WIDTH, HEIGHT);
    adjust(&mut constants);
    let format = Format { gloss };
    let layers = constants.foveation.layers;
    let flags = [("HAS_GLOSS", gloss), ("FOVEATED", layers), ("SPARSE", sparse), ("ACCEPTS_MIXED", accepts_mixed)];
    let overrides = [&PLAIN[..], &flags].concat();
    let mut cases = Cases::default();
    for (round, stripe) in stripes().iter().enumerate() {
        let eyes = inputs(&mut random, &constants, format, sparse);
        let light = |at: usize| format.unpack_sampled(eyes.left_radiance[at]);
        let pixel = |view, at| eyes.pixel(&constants, view, at, light(at));
        let left: Vec<_> = (0..constants.area()).map(|at| pixel(0, at)).collect();
        let twin = Twin { constants: &constants, sparse, accepts_mixed, left: &left };
        let tally: Vec<u32> = (0..constants.area()).map(|_| random.bits() & 0x0fff_ffff).collect();
        let before = random.rubbish::<4>(constants.area());
        let outputs = run(&constants, stripe, &overrides, &eyes, &before, &tally, None);
        let (radiance, counted) = (outputs.get::<[u32; 4]>("radiance_image"), outputs.get::<u32>("tally_image"));
        let mut holes = Vec::new();
        for (x, y) in stripe.pixels(WIDTH) {
            let at = constants.index(x, y);
            let fate = twin.fate((x, y), &pixel(1, at), &mut cases);
            let place = format!("({x}, {y}) of round {round}: {fate:?}");
            let mut why = 0;
            match fate {
                Fate::Gathered(light) => {
                    cases.meet("gathered");
                    // The column has a few rounding errors of its 21 pixels, and so have the weights of both taps.
                    let holds = format.holds_sampled(radiance[at], &light, 2e-4);
                    assert!(holds, "{place}: {:?}", format.unpack(radiance[at]));
                }
                Fate::Sky => cases.meet("sky"),
                Fate::LeftToFilter => {
                    cases.meet("left to the denoiser");
                    why = Counts::SKIPPED;
                }
                Fate::Hole(reason) => {
                    cases.meet(reason.name());
                    why = reason as u32;
                    holes.push(at as u32);
                }
            }
            if !matches!(fate, Fate::Gathered(_)) {
                assert_eq!(radiance[at], [0; 4], "{place}");
            }
            assert_eq!(Counts::unpack(counted[at]), Counts { why, ..Counts::unpack(tally[at]) }, "{place}");
        }
        assert_lists(&outputs.get::<u32>("new_list"), LIST_GROUP, holes);
        if !sparse {
            let listed: Vec<u32> = (0..constants.area() as u32).filter(|_| random.chance(0.5)).collect();
            let outputs = run(&constants, stripe, &overrides, &eyes, &before, &counted, Some(&listed));
            let (shared, recounted) = (outputs.get::<[u32; 4]>("radiance_image"), outputs.get::<u32>("tally_image"));
            let mut unshared = Vec::new();
            for (x, y) in stripe.pixels(WIDTH) {
                let at = constants.index(x, y);
                let is_listed = listed.contains(&(at as u32));
                let is_taken_over =
                    is_listed && matches!(twin.fate((x, y), &pixel(1, at), &mut cases), Fate::Gathered(_));
                assert_eq!(shared[at], if is_taken_over { radiance[at] } else { before[at] }, "({x}, {y})");
                let counts = Counts::unpack(counted[at]);
                let why = if is_taken_over { 0 } else { counts.why };
                assert_eq!(Counts::unpack(recounted[at]), Counts { why, ..counts }, "({x}, {y})");
                unshared.extend((is_listed && !is_taken_over).then_some(at as u32));
            }
            assert_lists(&outputs.get::<u32>("new_list"), LIST_GROUP, unshared);
        }
    }
    cases.assert_met(&["gathered", "sky", "outside", "normal", "distance", "material", "mixed", "view"]);
    cases.assert_met(&["gathered in a mirror", "gathered outside", "view in a mirror"]);
    cases.assert_met(expected);
}

#[test]
fn reproject_gathers_light_and_classifies_holes() {
    compare([false; 3], |_| {}, 61, &[]);
    compare([true, false, false], |_| {}, 62, &[]);
}

/// Filtered frames need no better light at edges, since the filter blends light there anyway.
#[test]
fn reproject_reuses_light_at_edges_before_a_filter() {
    compare([false, false, true], |_| {}, 69, &[]);
    compare([true, true, true], |_| {}, 70, &["not sampled, but traced"]);
}

/// With temporal accumulation, rays go through different points of the pixel. The eyes are swapped, so that surfaces
/// leave the left eye's image on the other side.
#[test]
fn reproject_gathers_at_jittered_ray_positions() {
    let adjust = |c: &mut Constants| {
        c.centre = Vec2::new(0.2, 0.9);
        c.eyes.swap(0, 1);
    };
    compare([false; 3], adjust, 63, &[]);
}

#[test]
fn reproject_leaves_unsampled_pixels_to_the_denoiser() {
    let share = |c: &mut Constants| c.foveation.sampled_fraction = 0.6;
    compare([false, true, false], share, 64, &["left to the denoiser", "not sampled"]);
    compare([true, true, false], share, 65, &["left to the denoiser", "not sampled"]);
    compare([false, true, false], |_| {}, 68, &["not sampled, but traced"]);
}

#[test]
fn reproject_accepts_unlike_surfaces_in_outer_layers() {
    let layers = |c: &mut Constants| c.foveation.layers = true;
    let expected = ["left to the denoiser", "not sampled", "not sampled, but traced"];
    compare([false, true, false], layers, 66, &expected);
    compare([true, true, false], layers, 67, &expected);
}

/// If surfaces fall on whole pixels of the left eye, light of neighbours is no substitute.
#[test]
fn reproject_reads_one_pixel_at_whole_disparities() {
    // At a distance of 4 the image is 4 wide, so eyes 0.5 apart have a disparity of two of 16 pixels.
    let eye = Eye::at_origin(Vec2::splat(0.5));
    let constants = Constants { eyes: [eye, eye.moved(0.5 * DVec3::X, 0.0, 0.0)], ..Constants::new(16, 1) };
    let format = Format { gloss: false };
    let guides = constants.eyes.map(|eye| {
        let behind = |x: u32| f64::from(eye.origin.x) + (f64::from(x) + 0.5) / 4.0 - 2.0;
        (0..16).map(|x| pack_guide(DVec3::new(behind(x), 0.0, -4.0), DVec3::Z)).collect::<Vec<_>>()
    });
    let light =
        |x: u32| Light { matte: DVec3::splat(f64::from(1 << x)), variance: DVec2::splat(UNKNOWN), ..Light::default() };
    let surface = [1, 2, 3, 7];
    let mut hit = [vec![surface; 16], vec![surface; 16]];
    hit[0][7][3] |= MIXED;
    let radiance = (0..16).map(|x| format.pack_sampled(&light(x))).collect();
    let eyes = Eyes { hit, guide: guides, left_radiance: radiance };
    let stripe = Stripe { rows: 0..1, valid: 0..1 };
    let outputs = run(&constants, &stripe, &PLAIN, &eyes, &[[9; 4]; 16], &[0; 16], None);
    let (gathered, counted) = (outputs.get::<[u32; 4]>("radiance_image"), outputs.get::<u32>("tally_image"));
    for x in 0..16 {
        let expected = match x {
            5 => Some(Why::Mixed),
            14.. => Some(Why::Outside),
            _ => None,
        };
        let why = Counts::unpack(counted[x as usize]).why;
        assert_eq!(why, expected.map_or(0, |why| why as u32), "pixel {x}");
        if expected.is_none() {
            let (got, want) = (format.unpack(gathered[x as usize]), light(x + 2));
            assert!(format.holds_sampled(gathered[x as usize], &want, 1e-5), "pixel {x}: {got:?} instead of {want:?}");
        }
    }
    assert_lists(&outputs.get::<u32>("new_list"), LIST_GROUP, vec![5, 14, 15]);
}

#[test]
fn reproject_dispatches_holes_in_whole_workgroups() {
    for count in [1, 32, 33, 64, 65] {
        let constants = Constants::new(count, 1);
        let zero = vec![[0; 4]; count as usize];
        let hit = [zero.clone(), vec![[1, 2, 3, 7 | MIXED]; count as usize]];
        let eyes = Eyes { hit, guide: [zero.clone(), zero.clone()], left_radiance: zero.clone() };
        let stripe = Stripe { rows: 0..1, valid: 0..1 };
        let outputs = run(&constants, &stripe, &PLAIN, &eyes, &zero, &vec![0; count as usize], None);
        assert_lists(&outputs.get::<u32>("new_list"), LIST_GROUP, (0..count).collect());
    }
}
