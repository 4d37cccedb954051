//! Options of commands that keep frames inside a budget, and what follows from them before anything is opened.

use std::path::{Path, PathBuf};

use anyhow::ensure;

use diptych::control::{Budget, Ladder, Measure, Origin};
use diptych::quality::{Denoiser, Quality};
use diptych::scene::head::{Recording, Space};

use super::Failure;
use super::ladder::Choice;
use crate::cli::foveation::FoveationOptions;
use crate::cli::options::{DEVICES, DenoiserChoice, OUTPUT, QUALITY, RenderOptions, RunOptions, SCENE};
use crate::cli::progress::Progress;

#[derive(clap::Args, Clone, Debug)]
pub struct LoopOptions {
    #[command(flatten)]
    pub run: RunOptions,
    /// Virtual devices on each chosen adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = DEVICES)]
    pub virtual_devices: u16,
    /// What a frame's makespan is kept within, milliseconds
    #[arg(long, default_value = "11..20", value_name = "LO..HI", help_heading = QUALITY)]
    pub budget_ms: Budget,
    /// A quality ladder that `diptych bench` measured [default: a built-in one: some settings are timed at the start,
    /// errors are estimated]
    #[arg(long, value_name = "FILE", help_heading = QUALITY)]
    pub ladder: Option<PathBuf>,
    /// Of all frames [default: svgf; with --ladder the one that most rungs have]
    #[arg(long, value_parser = Denoiser::value_parser(), help_heading = QUALITY)]
    pub denoiser: Option<DenoiserChoice>,
    #[command(flatten)]
    pub foveated: FoveationOptions,
    /// Frames per second, of the clock and of the camera path, which is walked to its end and back again [default: as
    /// many as the upper end of the budget allows]
    #[arg(long, help_heading = SCENE)]
    pub fps: Option<f64>,
    /// Write where the head was in each frame, for --motion
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub record_motion: Option<PathBuf>,
}

impl LoopOptions {
    /// Options with the most that any frame has.
    fn render_options(&self, choice: &Choice, frames: u32) -> RenderOptions {
        let most = self.foveated.limit(&Quality { fovea: self.foveated.radii(), ..choice.most() });
        RenderOptions {
            foveated: FoveationOptions { iterations: Some(most.iterations), ..self.foveated.clone() },
            frames,
            fps: self.fps.unwrap_or(1e3 / self.budget_ms.hi_ms()),
            ..RenderOptions::single(self.run.clone(), &most)
        }
    }

    /// Begins the file of --record-motion, if there is to be one. A file that a killed run left is kept, which is said.
    pub fn recording(&self, space: Space, progress: &Progress) -> Result<Option<Recording>, Failure> {
        let Some(path) = &self.record_motion else { return Ok(None) };
        let (recording, kept) = Recording::create(space, path)?;
        if let Some(kept) = kept {
            let kept = kept.display();
            progress.warn(&format!("the last recording of {} did not finish: it is kept in {kept}", path.display()));
        }
        Ok(Some(recording))
    }

    /// Where the rungs are from, in words.
    pub fn ladder_name(&self, ladder: &Ladder) -> String {
        let Origin { shot, size, measure, .. } = ladder.origin();
        match (&self.ladder, measure) {
            (None, _) => "built in (some settings timed at the start, errors estimated)".to_owned(),
            (Some(path), Measure::Estimate) => format!("{} (estimated for {shot} at {size})", path.display()),
            (Some(path), _) => format!("{} ({} measured on {shot} at {size})", path.display(), measure.name()),
        }
    }

    /// What clap cannot see.
    fn check(&self, choice: &Choice, options: &RenderOptions) -> Result<(), anyhow::Error> {
        self.foveated.check(choice.denoiser)?;
        let (is_asked, filters) = (choice.denoiser.is_some(), options.quality().denoiser.is_some());
        ensure!(filters || !is_asked, "--iterations 0 filters nothing: choose --denoiser none");
        let what = "--foveation layers leaves pixels to a denoiser: choose another than none";
        ensure!(filters || !self.foveated.is_on(), what);
        if let Some(path) = &self.record_motion {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let is_file = path.file_name().is_some() && !path.is_dir() && folder.is_none_or(Path::is_dir);
            ensure!(is_file, "--record-motion: there can be no file {}", path.display());
        }
        options.check()
    }
}

/// Options that are known to go together.
pub struct Prepared {
    pub options: LoopOptions,
    pub choice: Choice,
    pub render: RenderOptions,
    /// Whether a smaller size is taken where no rung fits the budget; none: the command has no such option.
    pub fits_size: Option<bool>,
    /// How many there are to be; none: until it is ended.
    pub frames: Option<u32>,
}

impl Prepared {
    pub fn new(options: &LoopOptions, frames: Option<u32>) -> Result<Self, Failure> {
        let choice = Choice::new(options)?;
        let render = options.render_options(&choice, frames.unwrap_or(u32::MAX));
        options.check(&choice, &render).map_err(Failure::Input)?;
        Ok(Self { options: options.clone(), choice, render, fits_size: None, frames })
    }
}
