//! Settings shared by all frames of a run.

use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;
use crate::loaded::LoadedScene;
use crate::passes::{FrameSpec, Views};
use crate::quality::Envelope;
use crate::scene::Scene;
use crate::scene::needs::SceneNeeds;
use crate::stages::{Foveation, Polar, SceneTables, StageSettings};

/// Settings shared by all frames of a run.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct RenderSettings {
    pub stages: StageSettings,
    pub seam: Seam,
    /// True if the halo plan adapts to its measured cost; otherwise it stays that of `seam`.
    pub adapts_halo: bool,
    /// Default seed of frames.
    pub seed: u32,
    /// Default maximum number of bounces. 0 and 1 are equivalent, since direct light is always included.
    pub bounces: u32,
    /// Render scale of each side of the image, as in [`crate::quality::Quality::scale`].
    pub scale: f64,
    /// Upper bound of indirect radiance; 0 disables it.
    pub indirect_clamp: f32,
    pub exposure_ev: f32,
    /// Maximum predicted time of a submission; `None` uses the limit of each device.
    pub max_dispatch_ms: Option<f64>,
}

impl RenderSettings {
    /// The defaults of `diptych render`: one sample per pixel, six bounces, a reprojected right eye, and SVGF. `tables`
    /// are those of `scene`.
    pub fn new(extent: Extent, scene: &Scene, tables: &SceneTables) -> Self {
        let needs = SceneNeeds { instances: tables.has_instances(), ..SceneNeeds::of(scene) };
        Self {
            stages: StageSettings { moving: tables.moving(), ..StageSettings::new(extent, needs) },
            seam: Seam::Halo(HaloPlan::RECOMPUTE),
            adapts_halo: true,
            seed: 0,
            bounces: 6,
            scale: 1.0,
            indirect_clamp: 0.0,
            exposure_ev: 0.0,
            max_dispatch_ms: None,
        }
    }

    /// Returns the settings of frames within these bounds, with a reprojected right eye. `extent` is the size of each
    /// eye's image.
    ///
    /// # Errors
    /// A message if eyes with custom optics would need too large a rectified image.
    pub fn for_envelope(scene: &LoadedScene, extent: Extent, envelope: &Envelope) -> Result<Self, String> {
        let Envelope { most: quality, mixes_spp } = envelope;
        let settings = Self::new(extent, &scene.scene, &scene.tables);
        let of_layers = || Foveation::new(scene.gaze.clone(), quality.iterations);
        let stages = StageSettings {
            spp: quality.spp,
            mixes_spp: *mixes_spp,
            filter: quality.denoiser,
            iterations: quality.most_iterations(),
            sparse: quality.scale < 1.0,
            foveation: quality.fovea.map(|radii| Foveation { radii, ..of_layers() }),
            polar: quality.polar.map(|space| Polar { gaze: scene.gaze.clone(), space }),
            rectified: scene.shot.rig.optics.as_ref().map(|optics| optics.rectified(extent)).transpose()?,
            ..settings.stages
        };
        let (bounces, scale, exposure_ev) = (quality.bounces, quality.scale, scene.shot.exposure_ev);
        Ok(Self { stages, bounces, scale, exposure_ev, ..settings })
    }

    /// Returns the spec of a frame on this many devices, with a history if the settings keep one. `has_surfaces` is
    /// true if anything in the scene reflects light.
    pub fn spec(&self, devices: usize, has_surfaces: bool) -> FrameSpec {
        let stages = &self.stages;
        FrameSpec {
            views: if stages.reproject { Views::Reprojected } else { Views::Traced },
            filter: stages.filter,
            sparse: stages.leaves_pixels(),
            iterations: stages.iterations,
            history_rows: stages.keeps_history().then_some(0),
            seam: self.seam,
            aovs: stages.aovs.clone(),
            has_surfaces,
            moving: stages.moving.clone(),
            screen: stages.polar.as_ref().map(|_| stages.screen()),
            blurs: stages.polar.as_ref().is_some_and(|polar| polar.space.blurs()),
            shown: stages.rectified.map(|_| stages.extent),
            is_late: stages.is_late,
            ..FrameSpec::new(stages.grid(), devices)
        }
    }
}
