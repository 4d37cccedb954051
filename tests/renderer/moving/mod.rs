//! Scenes that move: the same bytes on any devices, the light of the still scene of each instant, and a history that follows
//! the surfaces.

mod bytes;
mod followed;
mod history;
mod rungs;
mod twins;

use crate::common::{Subject, still_rig};
use crate::reference::scenes::moving;
use diptych::scene::Scene;

/// Eyes that stand still, in one place.
pub fn watched(scene: Scene) -> Subject {
    let camera = moving::camera();
    let rig = still_rig(camera.origin, camera.forward, camera.up, camera.tan_half_yfov);
    Subject::new(&scene.name.clone(), scene, rig)
}
