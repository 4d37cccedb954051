//! Subjects seen by a camera of the reference, and the light of pictures.

use crate::common::{Subject, still_rig};
use crate::reference::Pinhole;
use crate::reference::scenes::{add_matte, empty, place, quad};
use diptych::image::{Extent, RgbImage};
use diptych::scene::Scene;
use diptych::scene::rig::{Rig, View};
use glam::{DVec2, DVec3, Vec3, dvec2, vec3};

/// Returns static eyes that both see the image of a camera.
pub fn rig_of(camera: &Pinhole) -> Rig {
    still_rig(camera.origin, camera.forward, camera.up, camera.tan_half_yfov)
}

pub fn seen((scene, camera): (Scene, Pinhole)) -> Subject {
    Subject::new(&scene.name.clone(), scene, rig_of(&camera))
}

/// Returns the subject with eyes that are 64 mm apart.
pub fn seen_apart((scene, camera): (Scene, Pinhole)) -> Subject {
    let rig = Rig { baseline_m: 0.064, ..rig_of(&camera) };
    Subject::new(&scene.name.clone(), scene, rig)
}

/// Returns a grey board that faces the origin and a wall behind it, each with its distance and half its width.
pub fn board_before_wall(board: [f32; 2], wall: [f32; 2]) -> Scene {
    let mut scene = empty("board before a wall");
    let grey = add_matte(&mut scene, Vec3::splat(0.5));
    for [distance, half] in [board, wall] {
        place(&mut scene, quad(vec3(-half, -half, -distance), 2.0 * half * Vec3::X, 2.0 * half * Vec3::Y, grey));
    }
    scene
}

/// Returns the distance of each pixel's centre from a point, in pixels. The point is in fractions of the image.
pub fn distances([x, y]: [f64; 2], extent: Extent) -> Vec<f64> {
    let [width, height] = [extent.width, extent.height].map(f64::from);
    let centre = |i: u32| [f64::from(i % extent.width) + 0.5, f64::from(i / extent.width) + 0.5];
    let off = |[column, row]: [f64; 2]| f64::hypot(column - x * width, row - y * height);
    (0..extent.area() as u32).map(|i| off(centre(i))).collect()
}

/// Returns the point of a view's image at which it sees a point, in pixels.
pub fn seen_at(view: &View, point: DVec3, extent: Extent) -> DVec2 {
    let along = point - view.origin.as_dvec3();
    let [right, up, forward] = [view.right, view.up, view.forward].map(|axis| along.dot(axis.as_dvec3()));
    let [width, height] = [extent.width, extent.height].map(f64::from);
    let pixels = height / 2.0 / f64::from(view.tan_half_yfov);
    dvec2(width / 2.0 + pixels * right / forward, height / 2.0 - pixels * up / forward)
}

/// Returns the mean of all channels of all pixels.
pub fn mean(image: &RgbImage) -> f64 {
    let values = image.pixels.as_flattened();
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64
}

pub fn brightest(image: &RgbImage) -> f32 {
    image.pixels.as_flattened().iter().fold(0.0, |a, b| a.max(*b))
}
