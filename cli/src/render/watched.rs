//! Frames that take long: their progress, and the end of a still with the samples that it has.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use super::Run;
use super::history::takes_long;
use crate::failure::Failure;
use crate::interrupt;
use crate::output::FrameImages;
use diptych::exec::FrameReport;
use diptych::frame::settings::Settings;

/// Longest time for completing a picture of the samples that a still has when a signal comes. A second signal ends it at
/// once.
const ENDING: Duration = Duration::from_secs(10);

impl Run<'_> {
    /// True if the next frame is rendered with progress.
    pub(super) fn is_watched(&self) -> bool {
        let Settings { frames_in_flight, time_limit, .. } = **self.options.settings;
        let is_alone = frames_in_flight == 1 || self.options.frames == 1;
        time_limit.is_some() || (is_alone && takes_long(self.last_ms))
    }

    /// Waits for the next frame; returns `None` after the last one.
    pub(super) fn next_frame(&mut self) -> Result<Option<FrameReport>, Failure> {
        let options = self.options;
        if self.renderer.in_flight() > 0 || !self.is_watched() {
            return Ok(self.renderer.finish()?);
        }
        if self.begun == options.frames || interrupt::is_set() {
            return Ok(None);
        }
        let params = self.renderer.frame(&self.loaded.shot.rig, options.time_s(self.begun), self.begun);
        self.begun += 1;
        // The frames of a sequence have all samples.
        let (is_still, progress) = (options.frames == 1, &self.progress);
        let what = if is_still { format!("of {} spp", options.quality().spp) } else { String::new() };
        let limit = options.settings.time_limit().unwrap_or(Duration::MAX);
        let (begin, mut ending, ends) = (Instant::now(), None, Arc::default());
        let frame = self.renderer.render_watched(&params, is_still.then_some(&ends), |fraction| {
            progress.part(fraction, &what);
            if is_still && interrupt::is_set() {
                let (since, writing) = ending.get_or_insert_with(|| (Instant::now(), Some(interrupt::writing())));
                if since.elapsed() > ENDING {
                    *writing = None;
                }
            }
            ends.fetch_or(begin.elapsed() >= limit || interrupt::is_set(), Ordering::Relaxed);
        })?;
        Ok(Some(frame))
    }

    /// Keeps the last warm-up frame in place of a still that a signal has prevented.
    pub(super) fn keep_history(&mut self) -> Result<(), Failure> {
        if !interrupt::is_set() || self.options.frames > 1 || !self.rows.frames.is_empty() {
            return Ok(());
        }
        let Some((frame, images)) = self.history.last.take() else { return Ok(()) };
        let read = || interrupt::as_none(FrameImages::read(&mut self.renderer, &self.options.aovs));
        let Some(images) = images.map_or_else(read, |images| Ok(Some(images)))? else { return Ok(()) };
        self.history.frames -= 1;
        self.keep(&FrameReport { index: 0, ..frame }, images)
    }
}
