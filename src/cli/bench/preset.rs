//! `diptych bench --preset`: published experiments, one module each, and their options.
//!
//! To add an experiment, write a module with `run` and `REFUSES`, add a variant to [`Experiment`] and a line to each of
//! its methods.

use anyhow::anyhow;
use clap::ValueEnum;

use super::{Args, andersson, bmfr, koskela, late, leria, peres};
use crate::cli::failure::Failure;
use crate::cli::settings::Given;
use crate::cli::setup;
use crate::report::{leria::FRAMES, once};

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Experiment {
    /// Leria et al.: every stage on all devices, beside path tracing alone
    Leria,
    /// Xu, Tong & Xu: dependent features left out of bmfr's fit, beside noise on all, and svgf
    Bmfr,
    /// Koskela et al.: visual-polar images beside as many samples spread evenly, and by a linear falloff
    Koskela,
    /// Andersson & Hansson: log-polar images in four modes, by rings around the gaze
    Andersson,
    /// Tables 4 and 5 of Peres: foveated sampling and denoising in layers
    Peres,
    /// Frames shown 1, 2 and 4 frames after their pose was taken from --motion, as they are and corrected
    Late,
}

impl Experiment {
    fn run(self, args: &Args) -> Result<(), Failure> {
        match self {
            Self::Leria => leria::run(args),
            Self::Bmfr => bmfr::run(args),
            Self::Koskela => koskela::run(args),
            Self::Andersson => andersson::run(args),
            Self::Peres => peres::run(args),
            Self::Late => late::run(args),
        }
    }

    /// Returns the options that the experiment does not accept, by the names of their fields.
    fn refuses(self) -> &'static [&'static str] {
        match self {
            Self::Leria => leria::REFUSES,
            Self::Bmfr => bmfr::REFUSES,
            Self::Koskela => koskela::REFUSES,
            Self::Andersson => andersson::REFUSES,
            Self::Peres => peres::REFUSES,
            Self::Late => late::REFUSES,
        }
    }
}

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = crate::cli::options::QUALITY)]
pub struct PresetOptions {
    /// Repeat a published experiment instead of the grid
    #[arg(long, value_name = "NAME", conflicts_with_all = ["seams", "spp", "bounces", "denoiser", "iterations", "reference"])]
    preset: Option<Experiment>,
    /// With --preset bmfr, koskela, andersson, peres or late: several shots
    ///
    /// With peres they stand for the scenes of the thesis: Pink Room, Sponza, Forest [default: builtin:checker,
    /// builtin:atrium and builtin:forest].
    #[arg(long, value_name = "SHOT,…", value_delimiter = ',', requires = "preset")]
    pub shots: Vec<String>,
    /// With --preset peres: factor on the thesis's resolutions
    #[arg(long, value_name = "F", requires = "preset", default_value_t = 0.25, value_parser = size_factor)]
    pub size_factor: f64,
    /// With --preset peres, andersson or late: instants along the path
    #[arg(long, value_name = "N", requires = "preset", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub instants: u32,
    /// With --preset leria: frames along the path
    #[arg(long, value_name = "N", requires = "preset", default_value_t = FRAMES, value_parser = clap::value_parser!(u32).range(1..=5000))]
    pub frames: u32,
    /// With --preset leria: also predict these device counts
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", requires = "preset", default_value = "4", value_parser = clap::value_parser!(u16).range(2..=64))]
    simulate: Vec<u16>,
}

fn size_factor(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok().filter(|factor: &f64| (0.01..=4.0).contains(factor));
    factor.ok_or_else(|| "give a number from 0.01 to 4".to_owned())
}

impl PresetOptions {
    /// Returns the device counts of --simulate without duplicates.
    pub fn simulated(&self) -> Vec<usize> {
        once(self.simulate.iter().copied().map(usize::from))
    }
}

/// Runs the experiment that the options name; `None` if they name none.
pub fn run(args: &Args) -> Option<Result<(), Failure>> {
    let experiment = args.preset.preset?;
    let typed = |id: &str| Given::here().and_then(|given| given.typed(id));
    let refusal = match experiment.refuses().iter().find_map(|id| typed(id)) {
        Some(option) => {
            let name = setup::name(&experiment);
            anyhow!("--preset {name}: {option} does not go with it: leave one of them out")
        }
        None if typed("shot").is_some() && typed("shots").is_some() => anyhow!("SHOT and --shots: give one of them"),
        None => return Some(experiment.run(args)),
    };
    Some(Err(Failure::Input(refusal)))
}
