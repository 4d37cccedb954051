//! Options of commands that keep frames inside a budget, and what follows from them before anything is opened.

use std::path::PathBuf;

use diptych::control::{Budget, Knobs};
use diptych::quality::Denoiser;

use super::Failure;
use super::ladder::Choice;
use crate::cli::foveation::{FoveationOptions, Iterations};
use crate::cli::options::{DEVICES, DenoiserChoice, QUALITY, RenderOptions, RunOptions, SCENE};

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
}

impl LoopOptions {
    pub fn layers(&self) -> Layers {
        let most = self.foveated.layer_iterations();
        Layers { foveal: most, all: self.foveated.iterations.is_some().then(|| most.into_iter().fold(0, u32::max)) }
    }

    /// Options with the most that any frame has.
    fn render_options(&self, choice: &Choice, frames: u32) -> RenderOptions {
        let most = choice.most(|k| k.iterations);
        let iterations = match self.foveated.is_on() {
            true => Iterations::Layers(self.foveated.layer_iterations().map(|limit| limit.min(most))),
            false => Iterations::All(self.layers().all.map_or(most, |limit| limit.min(most))),
        };
        RenderOptions {
            run: self.run.clone(),
            spp: choice.most(|k| k.spp),
            scale: choice.least_scale(),
            bounces: choice.most(|k| k.bounces),
            denoiser: choice.denoiser,
            foveated: FoveationOptions { iterations: Some(iterations), ..self.foveated.clone() },
            frames,
            fps: self.fps.unwrap_or(1e3 / self.budget_ms.hi_ms()),
            frames_in_flight: 1,
            aov: Vec::new(),
        }
    }

    /// What clap cannot see.
    fn check(&self, choice: &Choice, options: &RenderOptions) -> Result<(), Failure> {
        self.foveated.check().map_err(Failure::Input)?;
        if choice.denoiser.is_some() && options.iterations() == 0 {
            return Err(Failure::Input(anyhow::anyhow!("--iterations 0 filters nothing: choose --denoiser none")));
        }
        if self.foveated.is_on() && choice.denoiser.is_none() {
            let what = anyhow::anyhow!("--foveation layers leaves pixels to a denoiser: choose another than none");
            return Err(Failure::Input(what));
        }
        options.check().map_err(Failure::Input)
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
        options.check(&choice, &render)?;
        Ok(Self { options: options.clone(), choice, render, fits_size: None, frames })
    }
}

/// The most iterations of any frame.
pub struct Layers {
    /// Of frames with foveal layers, by layer.
    foveal: [u32; 3],
    /// Of all, where there is a limit.
    all: Option<u32>,
}

impl Layers {
    /// Of a rung.
    pub fn of(&self, knobs: &Knobs) -> [u32; 3] {
        match (knobs.fovea, self.all) {
            (Some(_), _) => self.foveal.map(|most| most.min(knobs.iterations)),
            (None, most) => [most.map_or(knobs.iterations, |most| most.min(knobs.iterations)); 3],
        }
    }
}
