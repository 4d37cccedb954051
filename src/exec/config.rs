//! Builds run configurations from scenes, and frame specs from run configurations.

use crate::frame::RunConfig;
use crate::image::Extent;
use crate::loaded::LoadedScene;
use crate::passes::{Display, FrameSpec, Views};
use crate::quality::Envelope;
use crate::scene::Scene;
use crate::scene::needs::SceneNeeds;
use crate::scene::studio;
use crate::tables::SceneTables;

impl RunConfig {
    /// Returns the defaults of `diptych render`: one sample per pixel, six bounces, a reprojected right eye, SVGF, and a
    /// radiance cache except for objects in the studio.
    /// `needs` and `tables` are those of `scene`.
    pub fn of_scene(extent: Extent, scene: &Scene, needs: SceneNeeds, tables: &SceneTables) -> Self {
        let mut config = Self::new(extent, needs);
        config.buffers.moving = tables.moving();
        // Most light comes directly, so that the cache costs more time than it saves.
        config.cache = !studio::has_ground(scene);
        config
    }

    /// Returns the configuration of frames whose quality stays within `envelope`, with a reprojected right eye.
    /// `extent` is the size of each eye's image.
    ///
    /// # Errors
    /// A message if eyes with custom optics would need too large a rectified image.
    pub fn for_envelope(scene: &LoadedScene, extent: Extent, envelope: Envelope) -> Result<Self, String> {
        let mut config = Self::of_scene(extent, &scene.scene, scene.needs, &scene.tables);
        let rig = &scene.shot.rig;
        config.buffers.views = rig.views;
        if rig.convergence_m.is_some() && (rig.optics.is_some() || envelope.most.polar.is_some()) {
            return Err(
                "convergence supports neither polar foveation nor the eye projections of head motion".to_owned()
            );
        }
        if let Some(optics) = &scene.shot.rig.optics {
            config.buffers.display = Display::Resampled { projection: optics.rectified(extent)?, is_late: false };
        }
        Ok(Self {
            envelope,
            gaze: scene.gaze.clone(),
            exposure_ev: scene.shot.exposure_ev,
            tone: scene.shot.tone,
            ..config
        })
    }

    /// Returns the spec of a frame on `devices` devices at the highest quality, with a history if frames keep one.
    /// `has_surfaces` is true if anything in the scene reflects light.
    pub fn spec(&self, devices: usize, has_surfaces: bool) -> FrameSpec {
        let (buffers, most) = (&self.buffers, &self.envelope.most);
        FrameSpec {
            view_count: buffers.views,
            sources: buffers.sources,
            views: if buffers.reproject { Views::Reprojected } else { Views::Traced },
            filter_once: self.filter_once,
            share_holes: self.share_holes,
            blind_iterations: self.blind_iterations,
            filter: most.denoiser(),
            sparse: self.envelope.leaves_pixels(),
            iterations: most.most_iterations(),
            history_rows: self.keeps_history().then_some(0),
            seam: self.execution.seam,
            aovs: buffers.aovs.clone(),
            has_surfaces,
            cache: self.caches(),
            moving: buffers.moving.clone(),
            chain: self.chain(),
            ..FrameSpec::new(self.grid(), devices)
        }
    }
}
