//! `diptych bench --preset` and `--experiment`: published experiments and your own.
//!
//! To add a preset, write a file in `experiments` and add a variant to [`Preset`] and a line to each of its methods.
//! If a file cannot describe the preset, write a module with `run` and `REFUSES` instead of the file.

use anyhow::anyhow;

use super::args::{Args, Preset};
use super::{experiment, late, leria, peres};
use crate::cli::failure::Failure;
use crate::cli::settings::Given;
use crate::cli::setup;

/// Experiment files of the presets, as text.
const ANDERSSON: &str = include_str!("experiments/andersson.toml");
const BMFR: &str = include_str!("experiments/bmfr.toml");
const KOSKELA: &str = include_str!("experiments/koskela.toml");

impl Preset {
    fn run(self, args: &Args) -> Result<(), Failure> {
        match self {
            Self::Leria => leria::run(args),
            Self::Bmfr => experiment::run_text(args, BMFR, "--preset bmfr"),
            Self::Koskela => experiment::run_text(args, KOSKELA, "--preset koskela"),
            Self::Andersson => experiment::run_text(args, ANDERSSON, "--preset andersson"),
            Self::Peres => peres::run(args),
            Self::Late => late::run(args),
        }
    }

    /// Returns the options that the experiment does not accept, by the names of their fields.
    fn refuses(self) -> &'static [&'static str] {
        match self {
            Self::Leria => leria::REFUSES,
            Self::Bmfr | Self::Koskela | Self::Andersson => experiment::REFUSES,
            Self::Peres => peres::REFUSES,
            Self::Late => late::REFUSES,
        }
    }
}

/// Runs the experiment that the options name; `None` if they name none.
pub fn run(args: &Args) -> Option<Result<(), Failure>> {
    let (name, refuses) = match (args.preset.preset, &args.preset.experiment) {
        (Some(preset), _) => (format!("--preset {}", setup::name(&preset)), preset.refuses()),
        (None, Some(_)) => ("--experiment".to_owned(), experiment::REFUSES),
        (None, None) => return None,
    };
    let typed = |id: &str| Given::here().and_then(|given| given.typed(id));
    let refusal = match refuses.iter().find_map(|id| typed(id)) {
        Some(option) => anyhow!("{name} cannot be combined with {option}: leave one of them out"),
        None if typed("shot").is_some() && typed("shots").is_some() => anyhow!("give either SHOT or --shots, not both"),
        None => {
            let file = args.preset.experiment.as_deref().map(|path| experiment::run_file(args, path));
            return args.preset.preset.map(|preset| preset.run(args)).or(file);
        }
    };
    Some(Err(Failure::Input(refusal)))
}
