//! Sequences whose flicker and ghosting have a closed form.

use super::*;
use crate::image::Extent;
use crate::image::display::linear_from_srgb;

const EXTENT: Extent = Extent { width: 24, height: 10 };
/// Side of the square and its step per frame, pixels.
const SIDE: usize = 6;
const STEP: usize = 4;
const SQUARE: f64 = 0.8;

/// Returns a grey image with these display values by column and row.
fn grey(shown: impl Fn(usize, usize) -> f64) -> RgbImage {
    vectors(|x, y| {
        let linear = linear_from_srgb(shown(x, y));
        [(linear / (1.0 - linear)) as f32; 3]
    })
}

fn vectors(at: impl Fn(usize, usize) -> [f32; 3]) -> RgbImage {
    RgbImage::from_fn(EXTENT, |x, y| at(x as usize, y as usize))
}

fn moving(motion: RgbImage, position: RgbImage, normal: RgbImage) -> Result<MovingSurfaces, ImageError> {
    MovingSurfaces::new(Surfaces::new(position, normal)?, motion)
}

fn in_square(x: usize, y: usize, left: usize) -> bool {
    (left..left + SIDE).contains(&x) && (2..2 + SIDE).contains(&y)
}

/// Returns a wall with a square in front of it, which has moved right by `moved` pixels.
fn scene(left: usize, moved: usize) -> MovingSurfaces {
    let inside = move |x, y| in_square(x, y, left);
    let motion = vectors(|x, y| [if inside(x, y) { -(moved as f32) } else { 0.0 }, 0.0, 0.0]);
    let position = vectors(|x, y| [x as f32, y as f32, if inside(x, y) { 5.0 } else { 0.0 }]);
    moving(motion, position, vectors(|_, _| [0.0, 0.0, 1.0])).unwrap()
}

fn square(left: usize) -> impl Fn(usize, usize) -> f64 {
    move |x, y| if in_square(x, y, left) { SQUARE } else { 0.0 }
}

fn temporal(frames: [(&RgbImage, &RgbImage, &MovingSurfaces); 2]) -> TemporalError {
    let [before, now] = frames.map(|(reference, image, _)| Pair::new(reference, image, 0.0).unwrap());
    let history = frames[1].2.history(frames[0].2).unwrap();
    now.change_since(&before, &history).unwrap().into()
}

#[track_caller]
fn assert_near(found: Option<f64>, expected: f64) {
    let found = found.unwrap();
    assert!((found - expected).abs() < 1e-5, "{found}, expected {expected}");
}

#[test]
fn constant_error_does_not_flicker() {
    let (reference, image) = (grey(|_, _| 0.5), grey(|x, y| 0.02 * (x + y) as f64));
    let surfaces = scene(3, 0);
    let found = temporal([(&reference, &image, &surfaces), (&reference, &image, &surfaces)]);
    assert_eq!((found.flicker, found.new_share, found.ghosting), (Some(0.0), Some(0.0), None));
}

/// The square disoccludes STEP columns of the wall behind it; its front occludes others.
#[test]
fn motion_of_the_reference_is_no_flicker() {
    let (before, now) = (scene(3, 0), scene(3 + STEP, STEP));
    let [was, is] = [grey(square(3)), grey(square(3 + STEP))];
    let found = temporal([(&was, &was, &before), (&is, &is, &now)]);
    assert_eq!((found.flicker, found.ghosting), (Some(0.0), None));
    assert_near(found.new_share, (STEP * SIDE) as f64 / EXTENT.area() as f64);
}

#[test]
fn uncovered_and_entering_surfaces_are_new() {
    let history = scene(3 + STEP, STEP).history(&scene(3, 0)).unwrap();
    let width = EXTENT.width as usize;
    for (i, history) in history.iter().enumerate() {
        let (x, y) = (i % width, i / width);
        let expected = match (in_square(x, y, 3 + STEP), in_square(x, y, 3)) {
            (true, _) => Sighting::At(i - STEP),
            (false, true) => Sighting::Hidden,
            (false, false) => Sighting::At(i),
        };
        assert_eq!(*history, expected, "{x}, {y}");
    }
    let from_outside = scene(2, 4).history(&scene(0, 0)).unwrap();
    assert_eq!(
        from_outside[2 * width + 2..2 * width + 5],
        [Sighting::Hidden, Sighting::Hidden, Sighting::At(2 * width)]
    );
}

/// The image holds (1 − α) of the previous frame without reprojection, like an exponential moving average.
#[test]
fn exponential_mean_ghosts_by_its_history_weight() {
    let (before, now) = (scene(3, 0), scene(3 + STEP, STEP));
    let (was, is) = (square(3), square(3 + STEP));
    let alpha = 0.2;
    let mean = grey(|x, y| alpha * is(x, y) + (1.0 - alpha) * was(x, y));
    let (was, is) = (grey(was), grey(is));
    let found = temporal([(&was, &was, &before), (&is, &mean, &now)]);
    // The image has this error at the square's old and new position, each STEP columns wide.
    let wrong = (1.0 - alpha) * SQUARE;
    let (area, moved) = (EXTENT.area() as f64, (STEP * SIDE) as f64);
    assert_near(found.flicker, wrong * moved / (area - moved));
    assert_near(found.ghosting, ((area - moved) / moved).sqrt());
}

/// The mean of |a − b| for a and b of ±σ is σ.
#[test]
fn independent_noise_flickers_by_its_deviation() {
    let sigma = 0.1;
    let reference = grey(|_, _| 0.5);
    let [a, b] = [1, 2].map(|bit| grey(move |x, y| 0.5 + sigma * if ((x + 5 * y) & bit) == 0 { 1.0 } else { -1.0 }));
    let surfaces = scene(3, 0);
    let found = temporal([(&reference, &a, &surfaces), (&reference, &b, &surfaces)]);
    assert_near(found.flicker, sigma);
}

#[test]
fn sky_has_neither_flicker_nor_ghosting() {
    let sky = || vectors(|_, _| [0.0; 3]);
    let surfaces = moving(sky(), sky(), sky()).unwrap();
    let (black, white) = (grey(|_, _| 0.0), grey(|_, _| 0.9));
    let found = temporal([(&black, &black, &surfaces), (&black, &white, &surfaces)]);
    assert_eq!(found, TemporalError { flicker: None, ghosting: None, new_share: None });
}

/// The nearest pixel to the reprojected point may lie across an edge.
#[test]
fn subpixel_motion_of_an_edge_uncovers_nothing() {
    let mut now = scene(3, 0);
    for motion in &mut now.motion_px {
        motion[0] = -0.6;
    }
    let history = now.history(&scene(3, 0)).unwrap();
    let width = EXTENT.width as usize;
    let row = 2 * width;
    assert_eq!(history[row + 3], Sighting::At(row + 3));
    assert_eq!(history[row + 3 + SIDE], Sighting::At(row + 3 + SIDE));
    assert_eq!(history[row + 5], Sighting::At(row + 4));
    assert!(!history.contains(&Sighting::Hidden));
}

/// The scale of the world does not matter, and a slanted plane is not taken for a disocclusion.
#[test]
fn slanted_plane_keeps_its_history_at_any_scale() {
    for scale in [1e-4f32, 1.0, 1e4] {
        let plane = |shift: f32| {
            let position = vectors(|x, y| [x as f32 + shift, y as f32, 3.0 * (x as f32 + shift)].map(|c| c * scale));
            let normal = vectors(|_, _| [-3.0, 0.0, 1.0].map(|c: f32| c / 10f32.sqrt()));
            moving(vectors(|_, _| [shift, 0.0, 0.0]), position, normal).unwrap()
        };
        let history = plane(1.4).history(&plane(0.0)).unwrap();
        let new = history.iter().filter(|h| **h == Sighting::Hidden).count();
        assert_eq!(new, EXTENT.height as usize, "only the last column comes from outside, at {scale}");
    }
}

#[test]
fn rejects_images_of_different_sizes() {
    let small = || RgbImage::filled(Extent::new(2, 2), [0.0; 3]);
    let large = || RgbImage::filled(Extent::new(3, 2), [0.0; 3]);
    assert!(moving(small(), large(), large()).is_err());
    let of = |image: &dyn Fn() -> RgbImage| moving(image(), image(), image()).unwrap();
    let (a, b) = (of(&small), of(&large));
    assert!(a.history(&b).is_err());
}

#[test]
fn change_at_rest_ignores_constant_errors() {
    let reference = grey(|_, _| 0.5);
    let [before, now] = [0.0, 0.1].map(|step| {
        let image = grey(|x, y| 0.02 * (x + y) as f64 + if x < 6 { step } else { 0.0 });
        Pair::new(&reference, &image, 0.0).unwrap()
    });
    let flicker = |a: &Pair, b: &Pair| TemporalError::from(a.change_at_rest(b).unwrap()).flicker;
    // A quarter of the columns changed by a tenth.
    assert_near(flicker(&now, &before), 0.025);
    assert_eq!(flicker(&now, &now), Some(0.0));
    let small = RgbImage::filled(Extent::new(3, 3), [0.5; 3]);
    assert!(now.change_at_rest(&Pair::new(&small, &small, 0.0).unwrap()).is_err());
}

/// Changes beyond 5 degrees of either gaze do not count.
#[test]
fn change_near_gaze_counts_pixels_near_both_gazes() {
    let extent = Extent::new(40, 20);
    let seen = |x: f64| Viewing { gaze: [x, 0.5], yfov_deg: 40.0 };
    // Converts degrees at the image's centre to pixels.
    let per_degree = 10.0 / 20f64.to_radians().tan() * 1f64.to_radians();
    let grey = |value: &dyn Fn(f64, f64) -> f64| {
        RgbImage::from_fn(extent, |x, y| [value(f64::from(x) + 0.5, f64::from(y) + 0.5) as f32; 3])
    };
    let still = grey(&|_, _| 0.25);
    let pair = |image: &RgbImage| Pair::new(&still, image, 0.0).unwrap();
    let flicker = |image: &RgbImage, gazes: [&Viewing; 2]| {
        TemporalError::from(pair(image).change_near_gaze(&pair(&still), gazes, 5.0).unwrap()).flicker
    };
    let all = flicker(&grey(&|_, _| 0.5), [&seen(0.5), &seen(0.5)]).unwrap();
    let far = |x: f64, y: f64, at: f64| f64::hypot(x - at, y - 10.0) > 6.0 * per_degree;
    let beyond = |at: f64| grey(&move |x, y| if far(x, y, at) { 0.5 } else { 0.25 });
    assert_eq!(flicker(&beyond(20.0), [&seen(0.5), &seen(0.5)]), Some(0.0));
    let moved = flicker(&beyond(20.0), [&seen(0.55), &seen(0.55)]).unwrap();
    assert!(0.0 < moved && moved < all, "{moved} of {all}");
    // Only pixels near both gazes count, in either order of frames.
    for gazes in [[&seen(0.5), &seen(0.55)], [&seen(0.55), &seen(0.5)]] {
        assert_eq!(flicker(&beyond(20.0), gazes), Some(0.0));
        assert_near(flicker(&grey(&|_, _| 0.5), gazes), all);
    }
    assert_eq!(flicker(&beyond(20.0), [&seen(0.1), &seen(0.9)]), None);
}
