//! Warm-up frames, which give the denoiser a history.

use crate::failure::Failure;
use crate::interrupt;
use crate::options::RenderOptions;
use crate::output::FrameImages;
use crate::preview::Preview;
use crate::progress::Progress;
use diptych::exec::{FrameReport, Renderer};
use diptych::loaded::LoadedScene;

/// Makespan from which the images of a warm-up frame of a still are read back, ms: a signal may come while devices are
/// busy with the next frame.
const SLOW_MS: f64 = 200.0;

/// Warm-up frames that are complete.
#[derive(Default)]
pub struct History {
    pub frames: u32,
    /// The last one, with its images if it was slow.
    pub last: Option<(FrameReport, Option<FrameImages>)>,
}

impl History {
    /// Renders `count` frames of the first frame's instant. A signal ends them.
    pub fn render(
        renderer: &mut Renderer,
        options: &RenderOptions,
        loaded: &LoadedScene,
        count: u32,
        progress: &Progress,
        preview: Option<&Preview>,
    ) -> Result<Self, Failure> {
        let mut history = Self::default();
        for before in (1..=count).rev().take_while(|_| !interrupt::is_set()) {
            let params = renderer.frame(&loaded.shot.rig, options.time_s(0), 0u32.wrapping_sub(before));
            let rendered = match takes_long(history.last_ms()) {
                true => renderer.render_watched(&params, None, |fraction| progress.part(fraction, "history")),
                false => renderer.render(&params),
            };
            let Some(frame) = interrupt::as_none(rendered.map_err(Failure::from))? else { break };
            let event = serde_json::json!({ "event": "warm_up_frame", "makespan_ms": frame.makespan_ms });
            progress.step(format!("history {:.1} ms", frame.makespan_ms), &event);
            preview.map_or(Ok(()), |file| file.show(|| Ok(FrameImages::read(renderer, &[])?.display)))?;
            let is_read = options.frames == 1 && frame.makespan_ms > SLOW_MS;
            let images = is_read.then(|| FrameImages::read(renderer, &options.aovs)).transpose()?;
            history.frames += 1;
            history.last = Some((frame, images));
        }
        Ok(history)
    }

    /// Returns the makespan of the last frame, ms.
    pub fn last_ms(&self) -> Option<f64> {
        self.last.as_ref().map(|(frame, _)| frame.makespan_ms)
    }
}

/// Returns true if the next frame probably takes long, and is rendered with progress; `last_ms` is the makespan of the
/// last frame. The first one may take any time.
pub fn takes_long(last_ms: Option<f64>) -> bool {
    last_ms.is_none_or(|ms| ms > 500.0)
}
