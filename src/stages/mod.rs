//! The renderer's passes on one device: their images, their pipelines, and the scene as shaders read it.
//!
//! [`DeviceStages`] creates the resources that passes bind, and records tasks with them. It knows of no other devices.

mod albedo_table;
mod alias;
mod color;
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
mod workgroups;

pub use compile::StageError;
pub use foveation::Foveation;
pub use images::{Images, Place};
pub use limits::{LimitExceeded, Remedy};
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

/// Source of random numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Sampler {
    /// Owen-scrambled Sobol'.
    #[default]
    Sobol,
    /// Independent random numbers (PCG)
    Pcg,
}

/// Settings that stay constant for a run and shape its pipelines.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct StageSettings {
    /// Size of each eye's image on the screen.
    pub extent: Extent,
    pub needs: SceneNeeds,
    pub sampler: Sampler,
    /// Maximum samples per pixel of a frame.
    pub spp: u32,
    /// Whether 1-spp (pixel centre) and jittered multi-spp frames mix in one run. If not, all frames are of the kind of
    /// [`Self::spp`], even those that take a single sample.
    pub mixes_spp: bool,
    pub filter: Option<Denoiser>,
    /// Maximum iterations of the filter.
    pub iterations: u32,
    /// Whether the right eye is reprojected.
    pub reproject: bool,
    /// Whether frames may leave pixels unsampled for the filter to fill, apart from foveation.
    pub sparse: bool,
    /// Foveation; `None` if all pixels are sampled and filtered alike.
    pub foveation: Option<Foveation>,
    /// Polar projection of the traced images; `None` if these are the screen's own.
    pub polar: Option<Polar>,
    /// Size of the shared (rectified) projection, if eyes are resampled from one because the rig has
    /// [`optics`](crate::scene::rig::Rig::optics).
    pub rectified: Option<Extent>,
    /// Whether late reprojection may show rectified images from another pose than they are rendered from.
    pub is_late: bool,
    pub aovs: Vec<Aov>,
    /// Dynamic geometry of the scene as its tables describe it; `None` for a static scene.
    pub moving: Option<Moving>,
    /// Declarations of the frames' passes. They are not sent to other ranks, which get them from their
    /// [`Host`](crate::exec::ranks::Host).
    #[serde(skip)]
    pub declarations: Declarations,
    /// Maximum number of frames in flight, at least 1.
    pub frames_in_flight: usize,
    pub checks: ShaderChecks,
}

impl StageSettings {
    /// Creates settings for one sample per pixel, a reprojected right eye, and SVGF.
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

    /// Returns the size of the pinhole images: of the shared projection if there is one, otherwise of the displayed
    /// images.
    pub fn screen(&self) -> Extent {
        self.rectified.unwrap_or(self.extent)
    }

    /// Returns the size of the traced images.
    pub fn grid(&self) -> Extent {
        self.polar.as_ref().map_or(self.screen(), |polar| polar.grid(self.screen()))
    }

    /// Returns the number of pixels in the traced image of an eye.
    pub(crate) fn pixels(&self, view: &layout::View) -> u64 {
        self.polar.as_ref().map_or(self.grid().area() as u64, |polar| polar.pixels(view, self.screen()))
    }

    /// Whether the samples of a frame of `spp` are jittered over the pixel. If not, its single sample goes through the
    /// centre.
    pub fn jitter(&self, spp: u32) -> bool {
        if self.mixes_spp { spp > 1 } else { self.spp > 1 }
    }

    /// Returns all values of [`Self::jitter`] that frames may have.
    fn jitters(&self) -> &'static [bool] {
        match (self.spp > 1, self.mixes_spp) {
            (true, true) => &[false, true],
            (true, false) => &[true],
            (false, _) => &[false],
        }
    }

    /// Returns the sub-pixel position of the rays that represent the whole pixel, in a frame of `spp`. If frames keep a
    /// history and are not jittered, it follows the R2 sequence (Roberts, "The Unreasonable Effectiveness of
    /// Quasirandom Sequences", 2018). Frames before the first count back from 2^32.
    pub fn centre(&self, frame: u32, spp: u32) -> Vec2 {
        if self.jitter(spp) || !self.keeps_history() {
            return Vec2::splat(0.5);
        }
        let at = |step: f64| (0.5 + f64::from(frame.cast_signed()) * step).rem_euclid(1.0) as f32;
        Vec2::new(at(0.754_877_666_246_692_8), at(0.569_840_290_998_053_3))
    }

    /// Whether pixels may be left unsampled for the filter to fill. A stage then lists the sampled ones.
    pub fn leaves_pixels(&self) -> bool {
        self.sparse || self.foveation.is_some()
    }

    /// Whether frames keep a history for the next.
    pub fn keeps_history(&self) -> bool {
        self.filter.is_some_and(Denoiser::keeps_history) && self.iterations > 0
    }

    /// Whether the filter is given variances, and specular radiance separate from diffuse radiance.
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
