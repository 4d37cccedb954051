//! Scenes that are ready for renderers.

use std::borrow::Cow;
use std::sync::Arc;

use crate::accel::{Accel, AccelError, Layout, TreeCache};
use crate::image::Extent;
use crate::scene::budget::Budget;
use crate::scene::complete::Overrides;
use crate::scene::folder::Access;
use crate::scene::head::{HeadMotion, Space};
use crate::scene::load::load_shot_within;
use crate::scene::needs::SceneNeeds;
use crate::scene::shot::{Gaze, Shot};
use crate::scene::{Scene, SceneError};
use crate::tables::{SceneTables, TableError};

/// An error of [`LoadedScene::load`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Accel(#[from] AccelError),
    #[error(transparent)]
    Tables(#[from] TableError),
}

/// A scene, its shot, and the scene's tables for devices. Several renderers can share the tables.
pub struct LoadedScene {
    /// The shot. [`Self::follow`] replaces its camera path by head motion.
    pub shot: Shot,
    /// The gaze of the left and the right eye: the shot's, or that of head motion.
    pub gaze: [Gaze; 2],
    /// The reference space of head poses.
    pub space: Space,
    /// The scene with its animation.
    pub scene: Scene,
    pub needs: SceneNeeds,
    pub tables: Arc<SceneTables>,
}

impl LoadedScene {
    /// Loads `builtin:NAME`, a shot (`.toml`) or a scene (`.gltf`, `.glb`). Memory is limited by the default
    /// [`Budget`]. A file may only name files in its own folder or below.
    ///
    /// ```
    /// let scene = diptych::LoadedScene::load("builtin:cornell")?;
    /// assert!(scene.scene.triangle_count() > 0);
    /// # Ok::<(), diptych::LoadError>(())
    /// ```
    ///
    /// # Errors
    /// [`LoadError`], which names the file.
    pub fn load(shot: &str) -> Result<Self, LoadError> {
        Self::load_within(shot, &Overrides::default(), Access::of(&Budget::default()))
    }

    /// Loads like [`Self::load`], with overrides of the shot's values, and with a memory budget and file permissions of
    /// your own.
    ///
    /// # Errors
    /// [`LoadError`], which names the file or the override.
    pub fn load_within(shot: &str, overrides: &Overrides, access: Access) -> Result<Self, LoadError> {
        let (shot, scene) = load_shot_within(shot, overrides, access)?;
        Self::new(shot, scene, access.budget, &TreeCache::off())
    }

    /// Builds the tables of a scene, with trees from the cache where it has them. Notes failures of the cache in the scene.
    ///
    /// # Errors
    /// [`LoadError`] if the scene is too large for the tables or the budget.
    pub fn new(shot: Shot, mut scene: Scene, budget: &Budget, cache: &TreeCache) -> Result<Self, LoadError> {
        let accel = {
            let _span = tracing::info_span!("build tree").entered();
            Accel::build_within(&scene, Layout::Auto, budget, cache)?
        };
        scene.notes.extend(cache.take_notes());
        let tables = SceneTables::within(&scene, accel, budget)?;
        let needs = SceneNeeds { instances: tables.has_instances(), ..SceneNeeds::of(&scene) };
        let gaze = [shot.gaze.clone(), shot.gaze.clone()];
        Ok(Self { space: Space::of(&shot.rig), shot, gaze, scene, needs, tables: Arc::new(tables) })
    }

    /// Replaces the camera path by head motion. `size` is the size of the image that each eye displays.
    ///
    /// # Errors
    /// A message that says why no frame can be rendered along this motion.
    pub fn follow(&mut self, motion: &HeadMotion, size: Extent) -> Result<(), String> {
        self.space = motion.space(&self.shot.rig)?;
        self.shot.rig = motion.rig(&self.shot.rig)?.plain_at(size);
        if let Some(gaze) = motion.gaze() {
            self.gaze = gaze;
        }
        self.shot.gaze = self.gaze[0].clone();
        Ok(())
    }

    /// Returns the scene at the time `time_s`, in seconds, as a static scene.
    pub fn at(&self, time_s: f64) -> Cow<'_, Scene> {
        if self.scene.motion.is_empty() { Cow::Borrowed(&self.scene) } else { Cow::Owned(self.scene.at(time_s)) }
    }

    /// Returns the shot's exposure in stops with the digits of the shot's file: for example -0.9 instead of
    /// -0.8999999761581421, which is the exact value of the nearest `f32`.
    pub fn exposure_ev(&self) -> f64 {
        let ev = self.shot.exposure_ev;
        ev.to_string().parse().unwrap_or(f64::from(ev))
    }
}
