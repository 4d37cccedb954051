//! Motion of a scene, with its lights and materials before animation.

use std::collections::BTreeSet;

use crate::scene::Scene;
use crate::scene::motion::{Motion, Target};

/// Motion of a scene.
pub(super) struct Moves {
    pub(super) motion: Motion,
    /// Lights and materials before animation. All other parts of this scene are empty, since the tables hold them.
    pub(super) rest: Scene,
    /// Indices of the animated materials.
    pub(super) changing: Vec<usize>,
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
        let colored = motion.animations.iter().flat_map(|a| &a.channels).filter_map(|channel| match channel.target {
            Target::BaseColor(material) => Some(material),
            _ => None,
        });
        let changing: BTreeSet<usize> = motion.emitters.iter().map(|e| e.index).chain(colored).collect();
        Some(Self { motion: motion.clone(), rest, changing: changing.into_iter().collect() })
    }

    /// Whether any light may move or change over time.
    pub fn changes_lights(&self) -> bool {
        let Motion { lights, lamps, emitters, .. } = &self.motion;
        !(lights.is_empty() && lamps.is_empty() && emitters.is_empty())
    }
}
