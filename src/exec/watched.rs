//! Renders frames that take long: they tell their progress, and may end before they have all samples.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::stopping::StopFlag;
use super::watch::Watch;
use super::{ExecError, FrameParams, FrameReport, Renderer};
use crate::samples::PixelSamples;

impl Renderer {
    /// Renders a frame like [`Self::render`], in submissions of bounded time. Calls `progress` repeatedly with the
    /// fraction of the work that is done.
    ///
    /// Once the flag `ends` is set, the frame ends with the samples that it has, and [`FrameReport::spp_done`] tells
    /// how many. Its bytes then depend on the time. Frames of one sample or of a fractional number per pixel ignore the
    /// flag, and so do those of several ranks. If the flag of [`super::Builder::stop`] is set as well, and it would take
    /// long to give each pixel a first sample, there is no frame, but [`ExecError::Stopped`].
    ///
    /// # Errors
    /// Errors of [`Self::render`].
    pub fn render_watched(
        &mut self,
        params: &FrameParams,
        ends: Option<&Arc<AtomicBool>>,
        mut progress: impl FnMut(f64),
    ) -> Result<FrameReport, ExecError> {
        self.check(params)?;
        let samples = params.quality.spp.shared(self.config.grid(), self.config.envelope.centres_one());
        self.watched(params, samples, ends, &mut progress)
    }

    /// Renders a frame like [`Self::render_watched`], but each pixel has its own sample sequence, of which the frame
    /// takes the range `samples`. Its length must not exceed [`spp`](crate::quality::Quality::spp) of the envelope's
    /// highest quality.
    ///
    /// # Errors
    /// Errors of [`Self::render`].
    pub fn render_samples_watched(
        &mut self,
        params: &FrameParams,
        samples: Range<u32>,
        mut progress: impl FnMut(f64),
    ) -> Result<FrameReport, ExecError> {
        let samples = PixelSamples::own(samples, self.config.envelope.centres_one());
        self.watched(params, samples, None, &mut progress)
    }

    fn watched(
        &mut self,
        params: &FrameParams,
        samples: PixelSamples,
        ends: Option<&Arc<AtomicBool>>,
        progress: &mut dyn FnMut(f64),
    ) -> Result<FrameReport, ExecError> {
        let is_alone = self.devices().iter().all(|device| device.is_on_first_rank());
        let can_end = samples.extra == 0.0 && samples.is_jittered != 0 && is_alone;
        let ends = ends.filter(|_| can_end).map_or_else(StopFlag::default, |flag| Arc::clone(flag).into());
        let watch = Arc::new(Watch::new(ends, self.devices().len()));
        self.begin_with(params, samples, &[], Some(watch))?;
        self.finish_last(progress)
    }
}
