//! Display resampling of rectified images, also from a later pose.

mod twin;

use diptych::layout::{Camera, Frame, PassConstants};
use diptych::projection::PolarSpace;
use glam::{DMat3, DVec2, DVec3, Vec2};

use self::twin::{Place, Shown, depth, resampled};
use super::camera::Constants;
use super::harness::{Buffer, Kernel, Outputs, Stripe};
use super::inputs::{Cases, HEIGHT, Random, WIDTH};
use super::pack::{floats, rgb};
use super::tonemap::{display_levels, shows};
use super::visual_polar::Polar;

/// Columns and rows of the display image.
const SIZE: [u32; 2] = [26, 17];
const AREA: usize = (SIZE[0] * SIZE[1]) as usize;

/// Returns a map from the display image to the middle of a rectified one with `scale` times as many pixels per axis,
/// seen from `moved`.
fn shown(random: &mut Random, scale: f64, moved: DVec3) -> Shown {
    let mut near = |by: f64| random.within(-by..by);
    let size = DVec2::new(WIDTH.into(), HEIGHT.into());
    let centre = 0.5 * DVec2::new(SIZE[0].into(), SIZE[1].into());
    let turn = DMat3::from_cols(
        DVec3::new(scale * (1.0 + near(0.2)), scale * near(0.1), near(0.008)),
        DVec3::new(scale * near(0.1), scale * (1.0 + near(0.2)), near(0.008)),
        DVec3::new(near(1.0), near(1.0), 1.0),
    );
    let from_shown = DMat3::from_translation(0.5 * size) * turn * DMat3::from_translation(-centre);
    Shown { from_shown, moved, size }
}

/// Returns noise, a ramp with a bright line, or uniform squares.
fn lights(random: &mut Random, kind: usize) -> Vec<[f32; 4]> {
    let light = |i: u32| {
        let (x, y) = (f64::from(i % WIDTH), f64::from(i / WIDTH));
        let color = match kind {
            0 => DVec3::from_array(std::array::from_fn(|_| random.within(0.0..1.5))),
            1 => DVec3::new(0.03 * x, 0.002 * x * x, if i % WIDTH == 7 { 1.4 } else { 0.04 * y }),
            _ if (x / 5.0).floor() as u32 % 2 == (y / 4.0).floor() as u32 % 2 => DVec3::new(1.2, 0.3, 0.8),
            _ => DVec3::new(0.1, 0.9, 0.8),
        };
        floats(color, random.within(0.0..9.0))
    };
    (0..WIDTH * HEIGHT).map(light).collect()
}

fn frame(constants: &Constants, shown: [Shown; 2]) -> (Frame, [Shown; 2]) {
    let [left, right] = shown.map(Shown::rounded);
    let frame = constants.frame();
    (Frame { camera: Camera { display_maps: [left.1, right.1], ..frame.camera }, ..frame }, [left.0, right.0])
}

fn run(
    kernel: &'static str,
    frame: &Frame,
    (stripe, view): (&Stripe, usize),
    is_motion: bool,
    buffers: &[(&str, Buffer)],
) -> Outputs {
    let [width, height] = SIZE;
    let pass = PassConstants { width, height, ..stripe.pass(view, [WIDTH, HEIGHT, is_motion.into()]) };
    let is_polar = frame.camera.views[0].rows > 0.0;
    let projection = is_polar.then_some(PolarSpace::Visual);
    Kernel::projected(projection, kernel, &[]).run_rows(frame, pass, buffers)
}

/// Returns the whole image, and stripes at its borders and inside. Kernels may read all of the rectified image.
fn stripes() -> impl Iterator<Item = (Stripe, usize)> {
    let rows = [0..SIZE[1], 5..13, 9..10, 12..SIZE[1], 0..4];
    rows.into_iter().map(|rows| Stripe { valid: 0..SIZE[1], rows }).enumerate().map(|(i, stripe)| (stripe, i % 2))
}

/// Returns the pixels of a stripe by index, with their centres.
fn pixels(stripe: &Stripe) -> impl Iterator<Item = (usize, DVec2)> + use<> {
    stripe.pixels(SIZE[0]).map(|(x, y)| ((y * SIZE[0] + x) as usize, DVec2::new(x.into(), y.into()) + 0.5))
}

/// Calls `compare` with images of these kinds on all stripes, seen by new eyes with these scales and later positions.
fn for_all(
    seed: u64,
    kinds: impl IntoIterator<Item = (usize, f64, DVec3)>,
    mut compare: impl FnMut(&Rectified, &Frame, (&Stripe, usize), &Shown),
) {
    let mut random = Random::new(seed);
    for (kind, scale, moved) in kinds {
        let image = Rectified::new(&mut random, kind);
        let eyes = [0, 1].map(|_| shown(&mut random, scale, moved));
        let (frame, eyes) = frame(&image.constants, eyes);
        stripes().for_each(|(stripe, view)| compare(&image, &frame, (&stripe, view), &eyes[view]));
    }
}

/// Asserts that rounding decides for less than `most` pixels.
fn assert_clear(cases: &Cases, most: usize) {
    let unclear = cases.count("left to rounding");
    assert!(unclear < most, "{unclear} pixels are left to rounding, {} are not", cases.count("moved"));
}

const SCALES: [f64; 4] = [0.05, 0.8, 2.5, 12.0];
/// Positions of later eyes, in pixels of the rectified image times the distance.
const MOVED: [DVec3; 3] = [DVec3::ZERO, DVec3::new(5.0, -3.0, 0.2), DVec3::new(-4.0, 2.0, -0.4)];

/// A rectified image with the distances of its surfaces. Some are sky, and some lie behind the later eye.
struct Rectified {
    light: Vec<[f32; 4]>,
    emission: Vec<[f32; 4]>,
    constants: Constants,
}

impl Rectified {
    fn new(random: &mut Random, kind: usize) -> Self {
        let constants = Constants { exposure: 1.4, centre: Vec2::new(0.3, 0.6), ..Constants::new(WIDTH, HEIGHT) };
        let distance = |random: &mut Random| match random.bits() % 8 {
            0 => 0.0,
            1 => random.within(0.02..0.15),
            _ => random.within(3.0..3.3),
        };
        let emission = (0..constants.area()).map(|_| floats(random.color(1.0), distance(random))).collect();
        Self { light: lights(random, kind), emission, constants }
    }

    fn light_at(&self, column: i64, row: i64) -> DVec3 {
        let held = |at: i64, count: u32| at.clamp(0, i64::from(count) - 1) as u32;
        rgb(self.light[self.constants.index(held(column, WIDTH), held(row, HEIGHT))])
    }

    fn depth(&self, view: usize, [x, y]: [usize; 2]) -> f64 {
        let (x, y) = (x as u32, y as u32);
        let distance = self.emission[self.constants.index(x, y)][3];
        depth(&self.constants.eyes[view], distance.into(), self.constants.through(x, y), self.constants.size())
    }
}

/// Compares displayed light with the twin, pixel by pixel; `place` returns a pixel's place in the rectified image.
fn compare_light(
    kernel: &'static str,
    image: &Rectified,
    frame: &Frame,
    (stripe, view): (&Stripe, usize),
    cases: &mut Cases,
    place: impl Fn(DVec2, &mut Cases) -> Option<Place>,
) {
    let mut random = Random::new(171);
    let (linear, display) = (random.rubbish::<4>(AREA), random.rubbish::<1>(AREA));
    let mut buffers = vec![
        ("rectified", Buffer::whole(&image.light)),
        ("linear", Buffer::image(&linear)),
        ("display", Buffer::image(&display)),
    ];
    if kernel == "late_reprojection" {
        buffers.push(("emission_image", Buffer::whole(&image.emission)));
    }
    let outputs = run(kernel, frame, (stripe, view), false, &buffers);
    let (linear, display) = (outputs.get::<[f32; 4]>("linear"), outputs.get::<u32>("display"));
    for (at, centre) in pixels(stripe) {
        let Some(place) = place(centre, cases) else {
            cases.meet("left to rounding");
            continue;
        };
        let want = resampled(&place, |x, y| image.light_at(x, y), image.constants.size(), cases);
        let off = (rgb(linear[at]) - want).abs().max_element();
        assert!(off < 1e-3 && linear[at][3] == 1.0, "{centre} of {stripe:?}: {:?} instead of {want}", linear[at]);
        let levels = display_levels(rgb(linear[at]), image.constants.exposure.into());
        assert!(shows(display[at], levels), "{centre}: {:08x} instead of {levels}", display[at]);
    }
}

const SHAPES: [&str; 5] = ["edge", "extreme", "parabola", "parabola that begins flat", "parabola that ends flat"];

#[test]
fn to_eye_averages_light_over_pixel_areas() {
    let mut cases = Cases::default();
    let kinds = (0..3).flat_map(|kind| SCALES.map(|scale| (kind, scale, MOVED[1])));
    for_all(172, kinds, |image, frame, stripe, eye| {
        compare_light("to_eye", image, frame, stripe, &mut cases, |at, _| Some(eye.place(at)));
    });
    cases.assert_met(&SHAPES);
}

#[test]
fn late_reprojection_places_surfaces_in_later_eyes() {
    let mut cases = Cases::default();
    let kinds = [(0, 0.8, MOVED[1]), (1, 1.2, MOVED[2]), (2, 0.7, MOVED[0]), (2, 2.5, MOVED[1])];
    for_all(173, kinds, |image, frame, (stripe, view), eye| {
        let place = |at, cases: &mut Cases| eye.later_place(at, |pixel| image.depth(view, pixel), cases);
        compare_light("late_reprojection", image, frame, (stripe, view), &mut cases, place);
    });
    cases.assert_met(&SHAPES);
    cases.assert_met(&["where it was", "moved", "sky", "behind the eye"]);
    assert_clear(&cases, 50);
}

/// The distances come from a visual-polar image, whose pixels beyond the ends of rings are not finite.
#[test]
fn late_reprojection_reads_depth_of_polar_images() {
    let mut random = Random::new(177);
    let mut cases = Cases::default();
    let polar = Polar::new(DVec2::new(-0.2, 0.1));
    let distance = |column: u32, row: u32| match (column / 20 + row / 9) % 4 {
        0 => 0.0,
        band => 3.0 + 0.1 * f64::from(band),
    };
    let emission = polar.image(|column, row| floats(DVec3::ONE, distance(column, row)));
    let image = Rectified { emission, ..Rectified::new(&mut random, 0) };
    let size = image.constants.size();
    let eyes = [0, 1].map(|_| shown(&mut random, 0.7, MOVED[1]));
    let (shown, eyes) = frame(&image.constants, eyes);
    let camera = Camera { display_maps: shown.camera.display_maps, ..polar.frame().camera };
    let frame = Frame { camera, display: shown.display, ..polar.frame() };
    for (stripe, view) in stripes() {
        let place = |at, cases: &mut Cases| {
            let is_clear = std::cell::Cell::new(true);
            let found = eyes[view].later_place(
                at,
                |[x, y]| {
                    let through = DVec2::new(x as f64, y as f64) + 0.5;
                    let place = polar.place_of(polar.eye.ray(through, size));
                    let row = (place.y as u32).min(polar.rows - 1);
                    let column = place.x * f64::from(polar.length(row));
                    let off = |v: f64| (v - v.round()).abs();
                    is_clear.set(is_clear.get() && off(place.y).min(off(column)) > 2e-3);
                    depth(&polar.eye, distance(column as u32, row), through, size)
                },
                cases,
            );
            found.filter(|_| is_clear.get())
        };
        compare_light("late_reprojection", &image, &frame, (&stripe, view), &mut cases, place);
    }
    cases.assert_met(&["moved", "sky"]);
    assert_clear(&cases, 50);
}

/// Compares an auxiliary image with the value of the nearest pixel.
fn compare_aov(
    kernel: &'static str,
    image: &Rectified,
    frame: &Frame,
    (stripe, view): (&Stripe, usize),
    (eye, is_motion): (&Shown, bool),
    cases: &mut Cases,
) {
    let mut random = Random::new(174);
    let mut buffers =
        vec![("rectified", Buffer::whole(&image.light)), ("aov", Buffer::image(&random.rubbish::<4>(AREA)))];
    let is_later = kernel == "aov_late_reprojection";
    if is_later {
        buffers.push(("emission_image", Buffer::whole(&image.emission)));
    }
    let aov = run(kernel, frame, (stripe, view), is_motion, &buffers).get::<[f32; 4]>("aov");
    for (at, centre) in pixels(stripe) {
        let place =
            if is_later { eye.later_place(centre, |p| image.depth(view, p), cases) } else { Some(eye.place(centre)) };
        let nearest = place.and_then(|place| Some((place.point, eye.nearest(place.point)?)));
        let Some((point, [x, y])) = nearest else {
            cases.meet("left to rounding");
            continue;
        };
        cases.meet(if point.cmplt(DVec2::ZERO).any() || point.cmpge(eye.size).any() { "outside" } else { "inside" });
        let value = image.light[image.constants.index(x as u32, y as u32)];
        let mut want = value.map(f64::from);
        if is_motion {
            let moved = eye.shown_point(point + DVec2::new(want[0], want[1])) - eye.shown_point(point);
            want = [moved.x, moved.y, 0.0, want[3]];
        }
        let off = aov[at].iter().zip(want).map(|(got, want)| (f64::from(*got) - want).abs()).fold(0.0, f64::max);
        // Motion is the difference of two points.
        let allowed = if is_motion { 1e-3 } else { 0.0 };
        assert!(off <= allowed, "{centre} of {stripe:?}: {:?} instead of {want:?}", aov[at]);
    }
}

#[test]
fn aov_to_eye_takes_nearest_value_and_display_motion() {
    let mut cases = Cases::default();
    for (seed, is_motion, scales) in [(175, false, [0.3, 0.9]), (178, true, [0.7, 1.6])] {
        for_all(seed, scales.map(|scale| (0, scale, MOVED[1])), |image, frame, stripe, eye| {
            compare_aov("aov_to_eye", image, frame, stripe, (eye, is_motion), &mut cases);
        });
    }
    cases.assert_met(&["inside", "outside"]);
    assert_clear(&cases, 20);
}

#[test]
fn aov_late_reprojection_takes_the_surface_value() {
    let mut cases = Cases::default();
    let kinds = [(0, 0.8, MOVED[1]), (0, 1.1, MOVED[2]), (0, 0.9, MOVED[0])];
    for_all(176, kinds, |image, frame, stripe, eye| {
        compare_aov("aov_late_reprojection", image, frame, stripe, (eye, false), &mut cases);
    });
    cases.assert_met(&["where it was", "moved", "sky", "behind the eye", "inside", "outside"]);
    assert_clear(&cases, 50);
}
