//! Configuration of a run: its images, the qualities that its frames may have, and how devices execute them.

use glam::Vec2;
use serde::{Deserialize, Serialize};

use super::settings::{HaloMode, Settings};
use super::{Foveation, Sampler};
use crate::device::ShaderChecks;
use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;
use crate::image::tone::ToneCurve;
use crate::layout;
use crate::passes::{Aov, Declarations, Display, ImageChain, Moving};
use crate::projection::{PolarSpace, within};
use crate::quality::{Denoiser, Envelope, Quality, SettingError};
use crate::samples::PixelSamples;
use crate::scene::needs::SceneNeeds;
use crate::scene::rig::Eye;
use crate::scene::shot::Gaze;

/// Images of a run, and the passes that write them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Buffers {
    /// Extent of each eye's displayed image.
    pub extent: Extent,
    /// Mapping from the screen image, which is a pinhole image, to the displayed one. Eyes with custom
    /// [`optics`](crate::scene::rig::Rig::optics) need [`Display::Resampled`].
    pub display: Display,
    /// Number of views of the [`Rig`](crate::scene::rig::Rig).
    pub views: usize,
    /// Number of views that are path traced if the others are reprojected, an odd one.
    pub sources: usize,
    /// True if views that are no sources are reprojected from the nearest one.
    pub reproject: bool,
    /// Auxiliary images.
    pub aovs: Vec<Aov>,
    /// Shader features that the scene needs.
    pub needs: SceneNeeds,
    /// Sizes of the dynamic geometry in the scene's tables; `None` for a static scene.
    pub moving: Option<Moving>,
    /// Declarations of the frames' passes. They are not sent to other ranks, which get them from their
    /// [`Host`](crate::exec::ranks::Host).
    #[serde(skip)]
    pub declarations: Declarations,
}

/// How devices execute the frames of a run.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Execution {
    pub seam: Seam,
    /// True if the halo plan adapts to its measured cost; otherwise it stays that of `seam`.
    pub adapts_halo: bool,
    /// Maximum predicted time of a submission; `None` uses the limit of each device.
    pub max_dispatch_ms: Option<f64>,
    /// Maximum number of frames in flight, at least 1.
    pub frames_in_flight: usize,
    pub checks: ShaderChecks,
}

impl Default for Execution {
    fn default() -> Self {
        Self {
            seam: Seam::Halo(HaloPlan::RECOMPUTE),
            adapts_halo: true,
            max_dispatch_ms: None,
            frames_in_flight: 1,
            checks: ShaderChecks::default(),
        }
    }
}

/// Configuration shared by all frames of a run. Gaze, seed and exposure are defaults of
/// [`FrameParams`](crate::exec::FrameParams).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunConfig {
    pub buffers: Buffers,
    /// Bounds of the qualities that frames may have. By default, a frame has the upper bound.
    pub envelope: Envelope,
    pub execution: Execution,
    pub sampler: Sampler,
    /// Upper bound of indirect radiance; 0 disables it.
    pub indirect_clamp: f32,
    /// True if a reprojected view takes over the light of its source after the denoiser's filter instead of before, so that both
    /// eyes see the same noise and blur. Has no effect if both eyes are traced, or with denoisers other than `svgf`.
    pub filter_once: bool,
    /// True if views of a rig with more than two take over the light of their shared holes from one another.
    pub share_holes: bool,
    /// Number of the first iterations of `atrous` that ignore differences in radiance.
    pub blind_iterations: u32,
    /// True if direct light with hard shadows bypasses the denoiser: it is traced at the first surfaces without noise,
    /// if the scene has few such lights ([`SceneNeeds::hard_lights`]).
    pub hard_shadows: bool,
    /// True if the denoiser sees the surfaces in perfect mirrors and behind clear glass instead of these
    /// ([`SceneNeeds::mirrors`]).
    pub follow_mirrors: bool,
    /// True if specular light of narrow lobes bypasses denoisers that would blur it
    /// ([`SceneNeeds::narrow_lobes`]).
    pub bypass_narrow_lobes: bool,
    /// True if paths of denoised frames see narrow lobes as rougher behind a wide bounce, which trades fireflies for a
    /// bias that shrinks with the number of samples ([`SceneNeeds::narrow_lobes`]).
    pub regularize: bool,
    /// True if denoised frames of one sample per pixel average base colour textures over each pixel.
    pub filter_textures: bool,
    /// True if paths may end in a radiance cache, see [`Self::caches`]. [`Self::of_scene`] disables it for objects in the
    /// studio.
    pub cache: bool,
    /// Fraction of the outer foveal layer's pixels that is not sampled, see [`Foveation::unsampled_fraction`].
    pub unsampled_fraction: f64,
    /// Gaze of the left and the right eye.
    pub gaze: [Gaze; 2],
    pub seed: u32,
    /// Exposure of displayed images, in stops. Half floats store radiances of up to at least 46,000 times white at this
    /// exposure.
    pub exposure_ev: f32,
    /// Tone curve of displayed images.
    pub tone: ToneCurve,
}

impl RunConfig {
    /// Creates the configuration of frames of [`Quality::default`], with a reprojected right eye.
    pub fn new(extent: Extent, needs: SceneNeeds) -> Self {
        Self {
            buffers: Buffers {
                extent,
                display: Display::Direct,
                views: 2,
                sources: 1,
                reproject: true,
                aovs: Vec::new(),
                needs,
                moving: None,
                declarations: Declarations::default(),
            },
            envelope: Quality::default().into(),
            execution: Execution::default(),
            sampler: Sampler::default(),
            indirect_clamp: 0.0,
            hard_shadows: true,
            follow_mirrors: true,
            bypass_narrow_lobes: true,
            filter_once: true,
            share_holes: true,
            blind_iterations: 3,
            regularize: true,
            filter_textures: true,
            cache: true,
            unsampled_fraction: Foveation::UNSAMPLED_FRACTION,
            gaze: Default::default(),
            seed: 0,
            exposure_ev: 0.0,
            tone: ToneCurve::default(),
        }
    }

    /// Checks whether all settings are valid, alone and together.
    ///
    /// # Errors
    /// [`SettingError`], except for [`SettingError::OutsideEnvelope`].
    pub fn check(&self) -> Result<(), SettingError> {
        self.envelope.most.check()?;
        let Extent { width, height } = self.buffers.extent;
        within("width", width, Extent::SIDES)?;
        within("height", height, Extent::SIDES)?;
        within("views", self.buffers.views, 1..=Eye::MOST_VIEWS)?;
        within("sources", self.buffers.sources, 1..=self.buffers.views)?;
        if self.buffers.sources.is_multiple_of(2) {
            return Err(SettingError::EvenSources(self.buffers.sources));
        }
        if self.buffers.views != 2 {
            let most = &self.envelope.most;
            let with = [
                (most.fovea.is_some() || most.polar.is_some(), "foveation"),
                (self.buffers.display != Display::Direct, "the eye projections of head motion"),
            ];
            if let Some((_, what)) = with.into_iter().find(|(is_set, _)| *is_set) {
                return Err(SettingError::NeedsTwoViews { what });
            }
        }
        within("frames in flight", self.execution.frames_in_flight, 1..=usize::MAX)?;
        within("clamp", self.indirect_clamp, 0.0..=f32::MAX)?;
        within("unsampled fraction", self.unsampled_fraction, 0.0..=1.0)?;
        let max_dispatch_ms = self.execution.max_dispatch_ms.unwrap_or(1.0);
        Ok(within("max_dispatch_ms", max_dispatch_ms, f64::MIN_POSITIVE..=f64::MAX)?)
    }

    /// Applies settings, except for those of quality, which [`Self::envelope`] bounds.
    pub fn apply(&mut self, settings: &Settings) {
        self.buffers.reproject = settings.reproject;
        self.buffers.sources = settings.sources as usize;
        self.execution = Execution {
            seam: settings.seam(),
            adapts_halo: settings.halo == HaloMode::Cost,
            max_dispatch_ms: settings.max_dispatch_ms,
            frames_in_flight: settings.frames_in_flight as usize,
            checks: settings.shader_checks,
        };
        self.sampler = settings.sampler;
        self.indirect_clamp = settings.clamp;
        self.hard_shadows = settings.hard_shadows;
        self.follow_mirrors = settings.follow_mirrors;
        self.bypass_narrow_lobes = settings.bypass_narrow_lobes;
        self.filter_once = settings.filter_once;
        self.share_holes = settings.share_holes;
        self.blind_iterations = settings.blind_iterations;
        self.regularize = settings.regularize;
        self.filter_textures = settings.filter_textures;
        self.cache = settings.cache.unwrap_or(self.cache);
        self.unsampled_fraction = settings.unsampled_fraction;
        self.seed = settings.seed;
    }

    /// Returns the default quality of frames.
    pub fn quality(&self) -> Quality {
        self.envelope.most
    }

    /// Returns the denoiser of all frames, if they are denoised.
    pub fn denoiser(&self) -> Option<Denoiser> {
        self.envelope.most.denoiser()
    }

    /// Returns the foveal layers; `None` if all pixels are sampled and filtered alike.
    pub fn foveation(&self) -> Option<Foveation> {
        let radii = self.envelope.most.fovea?;
        Some(Foveation { radii, unsampled_fraction: self.unsampled_fraction })
    }

    /// Returns the gaze of both eyes at `time_s`, in fractions of their images.
    pub fn gaze_at(&self, time_s: f64) -> [[f64; 2]; 2] {
        self.gaze.each_ref().map(|gaze| gaze.at(time_s))
    }

    /// Returns the chain of images of an eye, from the traced to the displayed one.
    pub fn chain(&self) -> ImageChain {
        ImageChain { polar: self.envelope.most.polar, display: self.buffers.display, displayed: self.buffers.extent }
    }

    /// Returns the size of the pinhole images: of the shared projection if there is one, otherwise of the displayed
    /// images.
    pub fn screen(&self) -> Extent {
        self.chain().screen()
    }

    /// Returns the size of the traced images.
    pub fn grid(&self) -> Extent {
        self.envelope.most.polar.map_or(self.screen(), |space| space.method().grid(self.screen()))
    }

    /// Returns the number of pixels in the traced image of an eye.
    pub(crate) fn pixels(&self, view: &layout::View) -> u64 {
        let pixels = |space: PolarSpace| space.method().pixels(view, self.screen());
        self.envelope.most.polar.map_or(self.grid().area() as u64, pixels)
    }

    /// Returns the sub-pixel position, 0 to 1, of the rays that represent the whole pixel in frame number `frame`. It is
    /// the pixel's centre, unless frames keep a history and this one is not jittered: then it follows the R2 sequence (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
    /// Frames before frame 0 have numbers that count down from 2^32 - 1.
    pub fn centre(&self, frame: u32, samples: PixelSamples) -> Vec2 {
        if samples.is_jittered != 0 || !self.keeps_history() {
            return Vec2::splat(0.5);
        }
        let at = |step: f64| (0.5 + f64::from(frame.cast_signed()) * step).rem_euclid(1.0) as f32;
        Vec2::new(at(0.754_877_666_246_692_8), at(0.569_840_290_998_053_3))
    }

    /// Returns true if frames keep a history for the next.
    pub fn keeps_history(&self) -> bool {
        self.denoiser().is_some_and(Denoiser::keeps_history)
    }

    /// Returns true if paths end in a radiance cache: if it is enabled, frames keep a history, nothing in the scene
    /// changes, and paths of some frames reach a second surface that reflects light.
    pub fn caches(&self) -> bool {
        let is_reflected_again = self.envelope.most.bounces > 1;
        self.cache && is_reflected_again && self.keeps_history() && self.buffers.moving.is_none()
    }

    /// Returns true if the denoiser filters specular and diffuse radiance separately, and knows absent light.
    fn filters_lobes(&self) -> bool {
        self.denoiser().is_some_and(|denoiser| denoiser.method().filters_lobes())
    }

    /// Returns true if the denoiser needs variances.
    fn is_guided_by_variance(&self) -> bool {
        self.denoiser().is_some_and(|denoiser| denoiser.method().needs_variance())
    }

    /// Returns true if specular light of narrow lobes bypasses the denoiser. If pixels are left to the filter, it has to
    /// fill in their specular light as well.
    fn bypasses_narrow_lobes(&self) -> bool {
        let leaves_out = self.denoiser().is_some_and(|denoiser| denoiser.method().leaves_out_narrow_lobes());
        self.bypass_narrow_lobes && self.buffers.needs.narrow_lobes && leaves_out && !self.envelope.leaves_pixels()
    }

    pub(crate) fn constants(&self, jitter: bool) -> Vec<(&'static str, bool)> {
        let mut constants = Vec::from(self.buffers.needs.constants());
        constants.push(("SOBOL", self.sampler == Sampler::Sobol));
        constants.push(("HAS_GLOSS", self.buffers.needs.gloss && self.filters_lobes()));
        constants.push(("MARKS_ABSENT", self.filters_lobes()));
        let is_denoised = self.denoiser().is_some();
        constants.push(("HAS_HARD_LIGHTS", self.hard_shadows && self.buffers.needs.hard_lights && is_denoised));
        constants.push(("HAS_MIRRORS", self.follow_mirrors && self.buffers.needs.mirrors && is_denoised));
        constants.push(("HAS_POLISH", self.follow_mirrors && self.buffers.needs.polish && is_denoised));
        constants.push(("IS_REGULARIZED", self.regularize && self.buffers.needs.narrow_lobes && is_denoised));
        constants.push(("FILTERS_TEXTURES", self.filter_textures && self.buffers.needs.textures && is_denoised));
        constants.push(("HAS_CACHE", self.caches()));
        constants.push(("HAS_NARROW_LOBES", self.bypasses_narrow_lobes()));
        constants.push(("ACCEPTS_MIXED", is_denoised));
        constants.push(("JITTER", jitter));
        constants.push(("MEASURES_VARIANCE", jitter && self.is_guided_by_variance()));
        constants.push(("HAS_MOTION", self.buffers.moving.is_some()));
        constants.push(("FOVEATED", self.envelope.most.fovea.is_some()));
        constants.push(("SPARSE", self.envelope.leaves_pixels()));
        constants.push(("VARIES_SAMPLES", self.envelope.most.spp.varies()));
        constants
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::projection::OutOfRange;

    fn refused(change: impl FnOnce(&mut RunConfig)) -> Option<SettingError> {
        let mut config = RunConfig::new(Extent::new(8, 6), SceneNeeds::ALL);
        change(&mut config);
        config.check().err()
    }

    #[test]
    fn rejects_invalid_run_settings() {
        assert_eq!(refused(|_| ()), None);
        let most = |change: fn(&mut Quality)| refused(|config| change(&mut config.envelope.most));
        let unfiltered = |change: fn(&mut Quality)| {
            refused(|config| {
                config.envelope.most.filter = None;
                change(&mut config.envelope.most);
            })
        };
        assert_eq!(most(|quality| quality.scale = 0.5), None);
        assert_eq!(unfiltered(|_| ()), None);
        assert_eq!(unfiltered(|quality| quality.scale = 0.5), Some(SettingError::ScaleWithoutDenoiser));
        let out_of_range = |change: fn(&mut RunConfig)| match refused(change) {
            Some(SettingError::OutOfRange(OutOfRange { name, .. })) => name,
            other => panic!("{other:?}"),
        };
        assert_eq!(out_of_range(|config| config.execution.frames_in_flight = 0), "frames in flight");
        assert_eq!(out_of_range(|config| config.buffers.extent.height = 0), "height");
        assert_eq!(out_of_range(|config| config.indirect_clamp = f32::NAN), "clamp");
        assert_eq!(out_of_range(|config| config.execution.max_dispatch_ms = Some(0.0)), "max_dispatch_ms");
    }
}
