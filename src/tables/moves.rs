//! Motion of a scene, with its lights and materials before animation.

use crate::scene::Scene;
use crate::scene::motion::Motion;

/// Motion of a scene.
pub(super) struct Moves {
    pub(super) motion: Motion,
    /// Lights and materials before animation. All other parts of this scene are empty, since the tables hold them.
    pub(super) rest: Scene,
}

impl Moves {
    /// Returns the motion of a scene; `None` if it is static.
    pub fn of(scene: &Scene) -> Option<Self> {
        let motion = &scene.motion;
        if motion.is_empty() {
            return None;
        }
        let (materials, lights) = (scene.materials.clone(), scene.lights.clone());
        let rest = Scene { materials, lights, ..Scene::empty(&scene.name) };
        Some(Self { motion: motion.clone(), rest })
    }

    /// Whether any light may move or change over time.
    pub fn changes_lights(&self) -> bool {
        let Motion { lights, lamps, emitters, .. } = &self.motion;
        !(lights.is_empty() && lamps.is_empty() && emitters.is_empty())
    }
}
