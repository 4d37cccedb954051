//! A noisy plane that moves, and a view that sees it for the first time.

use super::with_denoiser;
use diptych::denoise::{FrameDenoiser, Given, Settings};
use diptych::image::Extent;
use diptych::scene::rig::View;
use glam::Vec3;

const EXTENT: Extent = Extent::new(48, 32);
const FRAMES: u32 = 12;
/// Mean radiance.
const LIGHT: f32 = 0.5;
/// Width of stripes of light and shadow, pixels.
const STRIPE: u32 = 4;

const CAMERA: View =
    View { origin: Vec3::ZERO, right: Vec3::X, up: Vec3::Y, forward: Vec3::NEG_Z, tan_half_yfov: 0.5, shift_x: 0.0 };

/// Returns the mean radiance of a column of pixels.
fn light(x: u32, is_striped: bool) -> f32 {
    if is_striped { 2.0 * LIGHT * (x / STRIPE % 2) as f32 } else { LIGHT }
}

/// A frame of a plane that faces the camera at this distance.
struct Plane {
    color: Vec<[f32; 3]>,
    position: Vec<[f32; 3]>,
}

impl Plane {
    fn new(distance: f32, index: u32, is_striped: bool) -> Self {
        let mut state = 0x9e37_79b9 ^ index.wrapping_mul(0x85eb_ca6b);
        let mut noise = move || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            (state >> 8) as f32 / (1 << 23) as f32
        };
        let pixels = || (0..EXTENT.height).flat_map(|y| (0..EXTENT.width).map(move |x| (x, y)));
        let per_pixel = 2.0 * CAMERA.tan_half_yfov * distance / EXTENT.height as f32;
        let [across, down] = [EXTENT.width, EXTENT.height].map(|side| 0.5 * side as f32 - 0.5);
        Self {
            color: pixels().map(|(x, _)| [light(x, is_striped) * noise(); 3]).collect(),
            position: pixels()
                .map(|(x, y)| [(x as f32 - across) * per_pixel, (down - y as f32) * per_pixel, -distance])
                .collect(),
        }
    }

    fn given<'a>(&'a self, albedo: &'a [[f32; 3]], normal: &'a [[f32; 3]]) -> Given<'a> {
        Given::new(CAMERA, &self.color, albedo, normal, &self.position)
    }
}

/// Returns the root mean square deviation of the last view's light from its mean.
fn deviation(denoiser: &mut FrameDenoiser, views: &[Given<'_>], is_striped: bool) -> f64 {
    let image = denoiser.denoise(views).unwrap().pop().unwrap();
    let pixels = (0..).zip(&image.pixels).flat_map(|(i, pixel)| pixel.map(|value| (i % EXTENT.width, value)));
    let squares = pixels.map(|(x, value)| f64::from(value - light(x, is_striped)).powi(2));
    (squares.sum::<f64>() / (3 * EXTENT.area()) as f64).sqrt()
}

/// A plane that approaches keeps its history if the frames say where it was.
#[test]
fn moving_surface_keeps_its_history() {
    let (albedo, normal) = ([[0.8; 3]; EXTENT.area()], [[0.0, 0.0, 1.0]; EXTENT.area()]);
    let distance = |index: u32| 8.0 * 0.96f32.powi(index as i32);
    let last = |tells: bool| {
        let settings = Settings { views: 1, is_animated: true, iterations: 1, ..Settings::new(EXTENT) };
        let frame = |denoiser: &mut FrameDenoiser, index: u32| {
            let plane = Plane::new(distance(index), index, false);
            let moved = |p: &[f32; 3]| [p[0], p[1], -distance(index.max(1) - 1)];
            let before: Vec<_> = plane.position.iter().map(moved).collect();
            let given = Given { last_position: tells.then_some(&before), ..plane.given(&albedo, &normal) };
            deviation(denoiser, &[given], false)
        };
        with_denoiser(&settings, |denoiser| (0..FRAMES).map(|index| frame(denoiser, index)).last().unwrap())
    };
    let [told, untold] = [true, false].map(last);
    println!("a deviation of {told:.4} with the last position, {untold:.4} without");
    assert!(told < 0.8 * untold, "{told} with the last position, {untold} without");
}

/// A surface that appears in the right view, while the left one has seen it before, continues the left one's history.
#[test]
fn right_view_uses_history_of_the_left() {
    let (albedo, normal) = ([[0.8; 3]; EXTENT.area()], [[0.0, 0.0, 1.0]; EXTENT.area()]);
    let nothing = [[0.0; 3]; EXTENT.area()];
    let last = |frames: u32| {
        with_denoiser(&Settings { iterations: 1, ..Settings::new(EXTENT) }, |denoiser| {
            for index in 0..frames {
                let plane = Plane::new(4.0, index, true);
                deviation(denoiser, &[plane.given(&albedo, &normal), plane.given(&albedo, &nothing)], true);
            }
            let [left, right] = [FRAMES, FRAMES + 1].map(|index| Plane::new(4.0, index, true));
            deviation(denoiser, &[left.given(&albedo, &normal), right.given(&albedo, &normal)], true)
        })
    };
    let [taken, own] = [FRAMES, 0].map(last);
    println!("a deviation of {taken:.4} after frames of the left view, {own:.4} without");
    assert!(taken < 0.8 * own, "{taken} after frames of the left view, {own} without");
}
