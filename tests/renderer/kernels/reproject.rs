//! Reprojection of the left eye's light into the right one, and the list of holes.

use glam::{DVec2, DVec3, Vec2};

use super::camera::Constants;
use super::edges::Surface;
use super::harness::{Buffer, Kernel, only_in};
use super::inputs::{Cases, HEIGHT, Random, WIDTH, Wall, stripes};
use super::pack::{Counts, Format, Light, MATERIAL_MASK, MIXED, VIEW_DEPENDENT, pack_guide};
use super::select::{assert_lists, empty_list};

/// Why a pixel is a hole, as the shader numbers it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Why {
    Outside = 1,
    Normal,
    Distance,
    Material,
    Mixed,
    View,
    /// Not sampled in the left eye.
    Skipped,
}

impl Why {
    fn name(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::Normal => "normal",
            Self::Distance => "distance",
            Self::Material => "material",
            Self::Mixed => "mixed",
            Self::View => "view",
            Self::Skipped => "skipped",
        }
    }
}

/// A pixel of either eye.
#[derive(Clone, Copy)]
struct Pixel {
    surface: Option<Surface>,
    is_mixed: bool,
    is_view_dependent: bool,
    material: u32,
    /// What was sampled; of the left eye only.
    light: Option<Light>,
}

/// What becomes of a pixel of the right eye.
#[derive(Debug)]
enum Fate {
    Sky,
    Gathered(Light),
    Hole(Why),
    LeftToFilter,
}

/// Why `left` has no light for the surface `right` of `material`, which is `reach` away from the left eye.
fn refusal(left: Option<&Pixel>, material: u32, right: &Surface, reach: f64, slack: f64) -> Option<Why> {
    let Some(left) = left else { return Some(Why::Outside) };
    if left.is_mixed {
        return Some(Why::Mixed);
    }
    if left.is_view_dependent {
        return Some(Why::View);
    }
    let Some(seen) = left.surface.filter(|_| left.material == material) else { return Some(Why::Material) };
    if right.normal.dot(seen.position - right.position).abs() >= 0.005 * slack * reach {
        return Some(Why::Distance);
    }
    if right.normal.dot(seen.normal) <= 1.0 - 0.01 * slack {
        return Some(Why::Normal);
    }
    left.light.is_none().then_some(Why::Skipped)
}

struct Twin<'a> {
    constants: &'a Constants,
    /// Whether pixels may be left to the filter.
    sparse: bool,
    left: &'a [Pixel],
}

impl Twin<'_> {
    fn fate(&self, (x, y): (u32, u32), right: &Pixel, cases: &mut Cases) -> Fate {
        let asked = !self.sparse || right.surface.is_none() || self.constants.is_sampled((x, y), 1);
        let hole = |why, is_wanted| if is_wanted { Fate::Hole(why) } else { Fate::LeftToFilter };
        if right.is_mixed {
            return hole(Why::Mixed, asked);
        }
        let Some(surface) = right.surface else { return Fate::Sky };
        if right.is_view_dependent {
            return hole(Why::View, asked);
        }
        let (left_eye, size) = (&self.constants.eyes[0], self.constants.size());
        let Some((seen, _)) = left_eye.seen_at(surface.position, size) else { return hole(Why::Outside, asked) };
        let column = seen.x - f64::from(self.constants.centre.x);
        let fraction = column - column.floor();
        let layer = self.constants.layer((x, y), 1);
        let reach = surface.position.distance(left_eye.origin.as_dvec3());
        let slack = f64::from(1 << layer);
        let taps = [0, 1].map(|i| {
            let tap = (column.floor() + f64::from(i)) as i64;
            let within = (0..i64::from(self.constants.width)).contains(&tap);
            within.then(|| &self.left[self.constants.index(tap as u32, y)])
        });
        let refusals = taps.map(|tap| refusal(tap, right.material, &surface, reach, slack));
        let light = |i: usize| taps[i].and_then(|tap| tap.light).filter(|_| refusals[i].is_none());
        let weighted = [(light(0), 1.0 - fraction), (light(1), fraction)];
        let weight: f64 = weighted.iter().filter_map(|(light, w)| light.map(|_| w)).sum();
        if weight >= 1e-4 {
            let of = |channel: fn(&Light) -> DVec3| -> DVec3 {
                weighted.iter().filter_map(|(light, w)| light.map(|light| channel(&light) * *w)).sum::<DVec3>() / weight
            };
            return Fate::Gathered(Light { matte: of(|l| l.matte), gloss: of(|l| l.gloss), variance: DVec2::ZERO });
        }
        if refusals.contains(&Some(Why::Skipped)) {
            // The filter fills it from what was sampled around it; only where all pixels are to have light it is traced.
            let is_full = layer == 0 && self.constants.foveation.sampled_share >= 1.0;
            cases.meet(if is_full { "not sampled, but traced" } else { "not sampled" });
            return hole(Why::Outside, is_full);
        }
        let nearer = usize::from(fraction > 0.5);
        hole(refusals[nearer].or(refusals[1 - nearer]).expect("both taps are refused"), asked)
    }
}

struct Eyes {
    hit: [Vec<[u32; 4]>; 2],
    guide: [Vec<[u32; 4]>; 2],
    left_radiance: Vec<[u32; 4]>,
}

fn inputs(random: &mut Random, constants: &Constants, format: Format, sparse: bool) -> Eyes {
    // Bumps and tilts around what the thresholds allow, which are wider in outer layers.
    let wall = if constants.foveation.layers { Wall::new(0.008, 0.2, 0.05) } else { Wall::new(0.003, 0.1, 0.05) };
    let area = constants.area();
    let mut hit = || -> Vec<[u32; 4]> {
        let flags = |random: &mut Random| match random.bits() % 20 {
            0 => MIXED,
            1 => VIEW_DEPENDENT,
            // Roughness has bits of its own.
            2..6 => 0x3f00_0000,
            _ => 0,
        };
        (0..area).map(|_| [1, 2, 3, random.pick(&[7, 7, 7, 8]) | flags(random)]).collect()
    };
    let hit = [hit(), hit()];
    let mut guide = [0, 1].map(|view| wall.guides(random, constants, view));
    let left = constants.eyes[0];
    for bits in &mut guide[1] {
        if random.chance(0.03) {
            let behind = left.origin.as_dvec3() - left.forward.as_dvec3() * random.within(0.1..2.0);
            *bits = pack_guide(behind + DVec3::Y, random.tilted(wall.normal, 0.1));
        }
    }
    let mut radiance = || match sparse && random.chance(0.4) {
        true => [0; 4],
        false => format.pack_sampled(&random.light(2.0)),
    };
    Eyes { hit, guide, left_radiance: (0..area).map(|_| radiance()).collect() }
}

fn compare(gloss: bool, sparse: bool, adjust: impl Fn(&mut Constants), seed: u64, expected: &[&'static str]) {
    let mut random = Random::new(seed);
    let mut constants = Constants { exposure: 1.7, ..Constants::new(WIDTH, HEIGHT) };
    adjust(&mut constants);
    let format = Format { gloss, exposure: constants.exposure.into() };
    let overrides =
        [("HAS_GLOSS", gloss), ("SOBOL", true), ("FOVEATED", constants.foveation.layers), ("SPARSE", sparse)];
    let mut cases = Cases::default();
    for (round, stripe) in stripes().iter().enumerate() {
        let eyes = inputs(&mut random, &constants, format, sparse);
        let pixel = |view: usize, at: usize| {
            let (hit, radiance) = (eyes.hit[view][at][3], eyes.left_radiance[at]);
            Pixel {
                surface: Surface::unpack(eyes.guide[view][at]),
                is_mixed: hit & MIXED != 0,
                is_view_dependent: hit & VIEW_DEPENDENT != 0,
                material: hit & MATERIAL_MASK,
                light: (radiance != [0; 4]).then(|| format.unpack(radiance)),
            }
        };
        let left: Vec<_> = (0..constants.area()).map(|at| pixel(0, at)).collect();
        let twin = Twin { constants: &constants, sparse, left: &left };
        let tally: Vec<u32> = (0..constants.area()).map(|_| random.bits() & 0x0fff_ffff).collect();
        let before = random.rubbish::<4>(constants.area());
        let image = |pixels: &[[u32; 4]]| Buffer::image(&only_in(&stripe.rows, WIDTH, pixels));
        let outputs = Kernel::new("reproject", &overrides).run(
            &constants,
            stripe.pass(1, [0; 3]),
            WIDTH,
            &[
                ("left_hit", image(&eyes.hit[0])),
                ("left_guide", image(&eyes.guide[0])),
                ("left_radiance", image(&eyes.left_radiance)),
                ("right_hit", image(&eyes.hit[1])),
                ("right_guide", image(&eyes.guide[1])),
                ("right_radiance", Buffer::image(&before)),
                ("right_tally", Buffer::image(&tally)),
                ("holes", Buffer::whole(&empty_list(constants.area()))),
            ],
        );
        let (radiance, counted) = (outputs.get::<[u32; 4]>("right_radiance"), outputs.get::<u32>("right_tally"));
        let mut holes = Vec::new();
        for (x, y) in stripe.rows.clone().flat_map(|y| (0..WIDTH).map(move |x| (x, y))) {
            let at = constants.index(x, y);
            let fate = twin.fate((x, y), &pixel(1, at), &mut cases);
            let place = format!("({x}, {y}) of round {round}: {fate:?}");
            let mut why = 0;
            match fate {
                Fate::Gathered(light) => {
                    cases.meet("gathered");
                    // The column is off by some roundings of its 21 pixels, and so is the share of either tap.
                    let holds = format.holds_sampled(radiance[at], &light, 2e-4);
                    assert!(holds, "{place}: {:?}", format.unpack(radiance[at]));
                }
                Fate::Sky => cases.meet("sky"),
                Fate::LeftToFilter => {
                    cases.meet("left to the filter");
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
        assert_lists(&outputs.get::<u32>("holes"), holes);
    }
    cases.assert_met(&["gathered", "sky", "outside", "normal", "distance", "material", "mixed", "view"]);
    cases.assert_met(expected);
}

#[test]
fn light_is_gathered_and_holes_are_told_apart() {
    compare(false, false, |_| {}, 61, &[]);
}

#[test]
fn gloss_is_gathered_beside_matte_light() {
    compare(true, false, |_| {}, 62, &[]);
}

/// Where frames are averaged, rays go through another point of the pixel. The eyes are swapped, so that surfaces lie
/// outside the left eye's image on its other side.
#[test]
fn light_is_gathered_where_rays_go_through_pixels() {
    let adjust = |c: &mut Constants| {
        c.centre = Vec2::new(0.2, 0.9);
        c.eyes.swap(0, 1);
    };
    compare(false, false, adjust, 63, &[]);
}

#[test]
fn pixels_that_the_mask_does_not_ask_for_are_left_to_the_filter() {
    let share = |c: &mut Constants| c.foveation.sampled_share = 0.6;
    compare(false, true, share, 64, &["left to the filter", "not sampled"]);
    compare(true, true, share, 65, &["left to the filter", "not sampled"]);
}

#[test]
fn outer_layers_allow_surfaces_to_differ_more() {
    let layers = |c: &mut Constants| c.foveation.layers = true;
    let expected = ["left to the filter", "not sampled", "not sampled, but traced"];
    compare(false, true, layers, 66, &expected);
    compare(true, true, layers, 67, &expected);
}
