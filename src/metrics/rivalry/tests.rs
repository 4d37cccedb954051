//! Two eyes before a wall with a square, whose errors have a known difference.

use super::super::surfaces::Surfaces;
use super::*;
use crate::image::RgbImage;
use crate::image::display::linear_from_srgb;

const EXTENT: Extent = Extent { width: 96, height: 60 };
/// Horizontal positions of the eyes. At the wall's depth, a pixel is one unit wide.
const EYES: [f32; 2] = [-1.0, 1.0];
const WALL_DEPTH: f32 = 10.0;
const SQUARE_DEPTH: f32 = 5.0;
/// Columns between the eyes' pictures of the wall.
const WALL_DISPARITY: usize = 2;
pub(in crate::metrics) const CENTRE: [f32; 2] = [0.5, 0.5];

/// Position of the surface in the middle of a pixel. The square is 20 pixels wide, and at half the wall's depth.
fn position(eye: usize, x: usize, y: usize) -> [f32; 3] {
    let [across, down] = [(x, EXTENT.width), (y, EXTENT.height)].map(|(i, n)| i as f32 + 0.5 - n as f32 / 2.0);
    let at = |depth: f32| [EYES[eye] + across * depth / WALL_DEPTH, -down * depth / WALL_DEPTH, -depth];
    let near = at(SQUARE_DEPTH);
    if near[0].abs() < 5.0 && near[1].abs() < 5.0 { near } else { at(WALL_DEPTH) }
}

/// For row vectors, as in EXR files.
pub(in crate::metrics) fn world_to_ndc(eye: usize) -> [[f32; 4]; 4] {
    let [across, down] = [EXTENT.width, EXTENT.height].map(|n| WALL_DEPTH / n as f32);
    [[across, 0.0, 0.0, 0.0], [0.0, -down, 0.0, 0.0], [-0.5, -0.5, 0.0, -1.0], [-across * EYES[eye], 0.0, 0.0, 0.0]]
}

pub(in crate::metrics) fn image(of: impl Fn(usize, usize) -> [f64; 3]) -> RgbImage {
    let linear = |shown: f64| {
        let linear = linear_from_srgb(shown);
        (linear / (1.0 - linear)) as f32
    };
    RgbImage::from_fn(EXTENT, |x, y| of(x as usize, y as usize).map(linear))
}

pub(in crate::metrics) fn surfaces(eye: usize) -> Surfaces {
    let positions = RgbImage::from_fn(EXTENT, |x, y| position(eye, x as usize, y as usize));
    Surfaces::new(positions, RgbImage::filled(EXTENT, [0.0, 0.0, 1.0])).unwrap()
}

fn in_right() -> Vec<Sighting> {
    surfaces(0).in_other_eye(&surfaces(1), &world_to_ndc(1), CENTRE).unwrap()
}

/// Differences between the eyes if their errors are these around a grey reference.
fn differences(errors: [&dyn Fn(usize, usize) -> [f64; 3]; 2]) -> Differences {
    let reference = image(|_, _| [0.5; 3]);
    let [left, right] =
        errors.map(|error| Pair::new(&reference, &image(|x, y| error(x, y).map(|e| 0.5 + e)), 0.0).unwrap());
    Differences::new(&left, &right, &in_right()).unwrap()
}

/// A number from −1 to 1 for each input.
fn noise(seed: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Noise that belongs to the surface at a pixel.
fn on_surface(eye: usize, x: usize, y: usize) -> [f64; 3] {
    let [px, py, pz] = position(eye, x, y).map(|c| (c * 4.0).round() as i64 as u64);
    [1, 2, 3].map(|c| 0.1 * noise(px ^ (py << 20) ^ (pz << 40) ^ (c << 60)))
}

#[track_caller]
fn assert_near(found: Option<f64>, expected: f64, tolerance: f64) {
    let found = found.unwrap();
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected}");
}

#[test]
fn surfaces_are_found_at_their_disparity() {
    let width = EXTENT.width as usize;
    let found = in_right();
    for (i, sighting) in found.iter().enumerate() {
        let (x, y) = (i % width, i / width);
        let disparity = if position(0, x, y)[2] == -SQUARE_DEPTH { 2 * WALL_DISPARITY } else { WALL_DISPARITY };
        let is_there = x >= disparity && position(1, x - disparity, y) == position(0, x, y);
        let expected = if is_there { Sighting::At(i - disparity) } else { Sighting::Hidden };
        assert_eq!(*sighting, expected, "{x}, {y}");
    }
    let hidden = found.iter().filter(|s| **s == Sighting::Hidden).count();
    // Two columns leave the image, and the square hides two more of the wall along its own rows.
    assert_eq!(hidden, WALL_DISPARITY * (EXTENT.height as usize + 20));
}

#[test]
fn errors_on_surfaces_cause_no_rivalry() {
    let found = differences([&|x, y| on_surface(0, x, y), &|x, y| on_surface(1, x, y)]).rivalry();
    for value in [found.rivalry, found.rivalry_mean, found.rivalry_p99] {
        assert_near(value, 0.0, 1e-12);
    }
    let all = EXTENT.area() as f64;
    assert_near(found.unmatched, (WALL_DISPARITY * (EXTENT.height as usize + 20)) as f64 / all, 1e-12);
}

/// Uniform noise of ±0.1 has a standard deviation of 0.1/√3.
#[test]
fn noise_of_each_eye_adds_in_squares() {
    let of = |seed: u64| {
        move |x, y| [1, 2, 3].map(|c| 0.1 * noise(seed ^ ((x as u64) << 8) ^ ((y as u64) << 20) ^ (c << 40)))
    };
    let found = differences([&of(1 << 50), &of(2 << 50)]).rivalry();
    let sigma = 0.1 / 3f64.sqrt();
    assert_near(found.rivalry, 2f64.sqrt() * sigma, 0.02 * sigma);
    assert!(found.rivalry_mean < found.rivalry && found.rivalry < found.rivalry_p99, "{found:?}");
    // The filters average over some pixels.
    assert!(found.rivalry_seen.unwrap() < 0.6 * found.rivalry.unwrap(), "{found:?}");
    let one = differences([&of(1 << 50), &|_, _| [0.0; 3]]).rivalry();
    assert_near(one.rivalry, sigma, 0.02 * sigma);
}

#[test]
fn brighter_eye_causes_uniform_rivalry() {
    let found = differences([&|_, _| [0.1; 3], &|_, _| [-0.05; 3]]).rivalry();
    for value in [found.rivalry, found.rivalry_mean, found.rivalry_p99, found.rivalry_seen] {
        assert_near(value, 0.15, 1e-6);
    }
}

#[test]
fn one_percent_of_the_pixels_is_in_the_percentile() {
    let bright =
        |fraction: u64| move |x: usize, y: usize| [if (x + 96 * y) as u64 % 1000 < fraction { 0.2 } else { 0.0 }; 3];
    let p99 = |fraction| differences([&bright(fraction), &|_, _| [0.0; 3]]).rivalry().rivalry_p99;
    assert_near(p99(5), 0.0, 1e-6);
    assert_near(p99(20), 0.2, 1e-6);
}

#[test]
fn only_changing_differences_flicker() {
    let history: Vec<Sighting> = (0..EXTENT.area()).map(Sighting::At).collect();
    let of = |left: f64, right: f64| differences([&move |_, _| [left; 3], &move |_, _| [right; 3]]);
    // Both eyes grow brighter by the same.
    assert_near(of(0.2, 0.1).flicker(&of(0.1, 0.0), &history), 0.0, 1e-6);
    assert_near(of(0.0, 0.1).flicker(&of(0.1, 0.0), &history), 0.2, 1e-6);
    let new = vec![Sighting::Hidden; EXTENT.area()];
    assert_eq!(of(0.0, 0.1).flicker(&of(0.1, 0.0), &new), None);
}

#[test]
fn without_shared_surfaces_rivalry_is_undefined() {
    let reference = image(|_, _| [0.5; 3]);
    let pair = Pair::new(&reference, &reference, 0.0).unwrap();
    let found = Differences::new(&pair, &pair, &vec![Sighting::Sky; EXTENT.area()]).unwrap().rivalry();
    assert_eq!(found.values(), [None; 5]);
    let small =
        Pair::new(&RgbImage::filled(Extent::new(2, 2), [0.0; 3]), &RgbImage::filled(Extent::new(2, 2), [0.0; 3]), 0.0);
    assert!(Differences::new(&pair, &small.unwrap(), &in_right()).is_err());
}

#[test]
fn means_need_all_frames() {
    let defined = differences([&|_, _| [0.1; 3], &|_, _| [0.0; 3]]).rivalry();
    let undefined = Rivalry { rivalry: None, ..defined };
    let mean = Rivalry::mean_of(&[defined, undefined]);
    assert_eq!((mean.rivalry, mean.rivalry_mean), (None, defined.rivalry_mean));
    assert_eq!(Rivalry::mean_of(&[]).values(), [None; 5]);
}
