//! Options of a session, and the settings derived from them before a device is opened.

use std::path::Path;

use anyhow::ensure;

use super::ladder::Choice;
use super::options::LoopOptions;
use crate::failure::Failure;
use crate::options::RenderOptions;
use diptych::quality::{Envelope, Quality};

impl LoopOptions {
    /// Returns render options with the maximum quality of any frame, for the settings of all frames.
    fn render_options(&self, choice: &Choice, frames: u32) -> Result<RenderOptions, anyhow::Error> {
        let settings = &self.run.settings;
        let envelope = Envelope::of(&choice.qualities);
        let most = settings.limit(&Quality { fovea: settings.layer_radii(), ..envelope.most });
        let envelope = Envelope { most, ..envelope };
        // The errors of the built-in ladder are measured against frames without a filter.
        let envelope = if choice.ladder.is_none() { envelope.with_unfiltered() } else { envelope };
        Ok(RenderOptions {
            frames,
            fps: settings.fps.unwrap_or(1e3 / self.budget_ms.hi_ms()),
            ..RenderOptions::new(self.run.clone(), envelope)
        })
    }

    /// Checks constraints that clap cannot express.
    fn check(&self, choice: &Choice, options: &RenderOptions) -> Result<(), anyhow::Error> {
        let settings = &self.run.settings;
        settings.check()?;
        let (is_asked, filters) = (choice.denoiser.is_some(), options.quality().filter.is_some());
        ensure!(filters || !is_asked, "--iterations 0 filters nothing: choose --denoiser none");
        let what = "--foveation layers needs a denoiser to fill in pixels: choose another than none";
        ensure!(filters || settings.layer_radii().is_none(), what);
        if let Some(path) = &self.record_motion {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let is_file = path.file_name().is_some() && !path.is_dir() && folder.is_none_or(Path::is_dir);
            ensure!(is_file, "--record-motion: cannot create the file {}", path.display());
        }
        options.check()
    }
}

/// Validated options of a session.
pub struct Prepared {
    pub options: LoopOptions,
    pub choice: Choice,
    pub render: RenderOptions,
    /// True if the run renders at a smaller size when no rung fits the budget; `None` if the command has no such
    /// option.
    pub fits_size: Option<bool>,
    /// Number of frames; `None` to render until the user ends the session.
    pub frames: Option<u32>,
}

impl Prepared {
    pub fn new(options: &LoopOptions, frames: Option<u32>) -> Result<Self, Failure> {
        let choice = Choice::new(options)?;
        let mut options = options.clone();
        options.run.settings.denoiser = choice.denoiser;
        if !options.run.settings.is_given("iterations") && options.run.settings.iterations == Some([0; 3]) {
            options.run.settings.iterations = None;
        }
        let render = options.render_options(&choice, frames.unwrap_or(u32::MAX)).map_err(Failure::Input)?;
        options.check(&choice, &render).map_err(Failure::Input)?;
        Ok(Self { options, choice, render, fits_size: None, frames })
    }
}
