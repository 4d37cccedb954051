//! The renderer's passes on one device: their images, their pipelines, and the scene as shaders read it.
//!
//! [`DeviceStages`] makes what declared passes bind, and records tasks with it. It does not know of other devices.

mod albedo_table;
mod alias;
mod compile;
mod emitters;
mod foveation;
mod images;
pub mod layout;
mod limits;
mod pipeline;
mod polar;
mod reflect;
mod scene_tables;
mod shader;
mod task;

pub use compile::StageError;
pub use foveation::Foveation;
pub use images::{Images, Place};
pub use limits::LimitExceeded;
pub use pipeline::DeviceStages;
pub use polar::{FOVEA_DEG, Polar, PolarPlace, acuity};
pub use reflect::{Mismatch, verify};
#[doc(hidden)] // For benchmarks.
pub use scene_tables::{SceneBuffers, layout_entries as scene_layout_entries};
pub use scene_tables::{SceneTables, SceneUpdate, TableError};
pub use shader::{all_shader_text, override_names, shader_text, shader_text_of};
pub use task::{StageTask, Stamps};

use glam::Vec2;

use crate::device::ShaderChecks;
use crate::image::Extent;
use crate::passes::{Aov, Declarations, Moving};
use crate::quality::{Denoiser, PolarSpace};
use crate::scene::needs::SceneNeeds;

/// How random numbers are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Sampler {
    /// Owen-scrambled Sobol'.
    #[default]
    Sobol,
    /// Independent.
    Pcg,
}

/// What stays the same for all frames of a run and shapes pipelines.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct StageSettings {
    /// Of each eye's image on the screen.
    pub extent: Extent,
    pub needs: SceneNeeds,
    pub sampler: Sampler,
    /// Samples per pixel of a frame, at most.
    pub spp: u32,
    /// Whether frames of one sample per pixel, which goes through its centre, are among frames of several. If not, all
    /// are of the same kind, also those that happen to take one sample of `spp`.
    pub mixes_spp: bool,
    pub filter: Option<Denoiser>,
    /// Of the filter, at most.
    pub iterations: u32,
    /// Whether the right eye is reprojected.
    pub reproject: bool,
    /// Whether frames may leave pixels to the filter, beside those that foveation does.
    pub sparse: bool,
    /// None: all pixels are sampled and filtered alike.
    pub foveation: Option<Foveation>,
    /// None: images are those of the screen.
    pub polar: Option<Polar>,
    /// Columns and rows of the rectified images, where eyes show others: of a rig with
    /// [`optics`](crate::scene::rig::Rig::optics).
    pub rectified: Option<Extent>,
    /// Whether rectified images may be shown as from another place than they are rendered from.
    pub is_late: bool,
    pub aovs: Vec<Aov>,
    /// What of the scene moves, if anything does, as its tables say.
    pub moving: Option<Moving>,
    /// The declarations of the passes of frames. They are not sent to other ranks, which have them from their
    /// [`Host`](crate::exec::ranks::Host).
    #[serde(skip)]
    pub declarations: Declarations,
    /// Frames that may be on the devices at a time, 1 at least.
    pub frames_in_flight: usize,
    pub checks: ShaderChecks,
}

impl StageSettings {
    /// One sample per pixel, a reprojected right eye, and SVGF.
    pub fn new(extent: Extent, needs: SceneNeeds) -> Self {
        Self {
            extent,
            needs,
            sampler: Sampler::default(),
            spp: 1,
            mixes_spp: false,
            filter: Some(Denoiser::SVGF),
            iterations: Denoiser::DEFAULT_ITERATIONS,
            reproject: true,
            sparse: false,
            foveation: None,
            polar: None,
            rectified: None,
            is_late: false,
            aovs: Vec::new(),
            moving: None,
            declarations: Declarations::default(),
            frames_in_flight: 1,
            checks: ShaderChecks::default(),
        }
    }

    /// The columns and rows of the pinholes' images: what eyes show, or is rectified.
    pub fn screen(&self) -> Extent {
        self.rectified.unwrap_or(self.extent)
    }

    /// The columns and rows of the images that are traced.
    pub fn grid(&self) -> Extent {
        self.polar.as_ref().map_or(self.screen(), |polar| polar.grid(self.screen()))
    }

    /// How many pixels the image of an eye has.
    pub(crate) fn pixels(&self, view: &layout::View) -> u64 {
        self.polar.as_ref().map_or(self.grid().area() as u64, |polar| polar.pixels(view, self.screen()))
    }

    /// Whether the samples of a frame of `spp` are spread over the pixel: one alone goes through its centre.
    pub fn jitter(&self, spp: u32) -> bool {
        if self.mixes_spp { spp > 1 } else { self.spp > 1 }
    }

    /// [`Self::jitter`] of the frames that there may be.
    fn jitters(&self) -> &'static [bool] {
        match (self.spp > 1, self.mixes_spp) {
            (true, true) => &[false, true],
            (true, false) => &[true],
            (false, _) => &[false],
        }
    }

    /// Where in a pixel rays of a frame of `spp` go that stand for all of it: another point in each frame where frames
    /// are averaged and one alone has no samples all over the pixel (Roberts, "The Unreasonable Effectiveness of
    /// Quasirandom Sequences", 2018: the R2 sequence). Frames before the first count back from 2^32.
    pub fn centre(&self, frame: u32, spp: u32) -> Vec2 {
        if self.jitter(spp) || !self.keeps_history() {
            return Vec2::splat(0.5);
        }
        let at = |step: f64| (0.5 + f64::from(frame.cast_signed()) * step).rem_euclid(1.0) as f32;
        Vec2::new(at(0.754_877_666_246_692_8), at(0.569_840_290_998_053_3))
    }

    /// Whether pixels may be left to the filter; a stage then lists those that are sampled.
    pub fn leaves_pixels(&self) -> bool {
        self.sparse || self.foveation.is_some()
    }

    /// Whether frames leave anything for the next.
    pub fn keeps_history(&self) -> bool {
        self.filter.is_some_and(Denoiser::keeps_history) && self.iterations > 0
    }

    /// Whether the filter knows variances, and gloss apart from matte light.
    fn is_guided_by_variance(&self) -> bool {
        self.filter.is_some_and(|denoiser| denoiser.method().needs_variance()) && self.iterations > 0
    }

    fn constants(&self, jitter: bool) -> Vec<(&'static str, bool)> {
        let mut constants = Vec::from(self.needs.constants());
        constants.push(("SOBOL", self.sampler == Sampler::Sobol));
        constants.push(("HAS_GLOSS", self.needs.gloss && self.is_guided_by_variance()));
        constants.push(("JITTER", jitter));
        constants.push(("MEASURES_VARIANCE", jitter && self.is_guided_by_variance()));
        constants.push(("HAS_MOTION", self.moving.is_some()));
        constants.push(("FOVEATED", self.foveation.is_some()));
        constants.push(("SPARSE", self.leaves_pixels()));
        constants.push(("POLAR", self.polar.is_some()));
        constants
            .push(("LOG_POLAR", self.polar.as_ref().is_some_and(|polar| matches!(polar.space, PolarSpace::Log(_)))));
        constants
    }
}

#[cfg(test)]
mod history_tests;
#[cfg(test)]
mod light_density_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod variant_tests;
