//! Subjects seen by a camera of the reference, and the light of pictures.

use crate::common::{Subject, still_rig};
use crate::reference::Pinhole;
use diptych::exec::PerView;
use diptych::image::RgbImage;
use diptych::scene::Scene;
use diptych::scene::rig::Rig;

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

pub fn eyes<T>(both: &PerView<T>) -> [&T; 2] {
    both.outer()
}

/// Returns the mean of all channels of all pixels.
pub fn mean(image: &RgbImage) -> f64 {
    let values = image.pixels.as_flattened();
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64
}

pub fn brightest(image: &RgbImage) -> f32 {
    image.pixels.as_flattened().iter().fold(0.0, |a, b| a.max(*b))
}
