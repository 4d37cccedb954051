//! `diptych bench --preset`: published experiments.
//!
//! An experiment is a file in `experiments`, which [`experiment::run`] executes, or a module with `run` and `REFUSES`
//! if it measures more than such a file can say. Add a variant to [`Experiment`] and a line to each of its methods.

use anyhow::anyhow;

use super::args::{Args, Experiment};
use super::{andersson, experiment, koskela, late, leria, peres};
use crate::cli::failure::Failure;
use crate::cli::settings::Given;
use crate::cli::setup;
use crate::report;

impl Experiment {
    fn run(self, args: &Args) -> Result<(), Failure> {
        match self {
            Self::Leria => leria::run(args),
            Self::Bmfr => embedded(args, include_str!("experiments/bmfr.toml"), "bmfr.csv"),
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
            Self::Bmfr => experiment::REFUSES,
            Self::Koskela => koskela::REFUSES,
            Self::Andersson => andersson::REFUSES,
            Self::Peres => peres::REFUSES,
            Self::Late => late::REFUSES,
        }
    }
}

/// Runs an experiment of this program.
fn embedded(args: &Args, text: &str, csv: &'static str) -> Result<(), Failure> {
    let experiment = report::experiment::Experiment::parse(text).map_err(|e| Failure::Input(anyhow!("{e}")))?;
    experiment::run(args, &experiment, csv)
}

/// Runs the experiment that the options name; `None` if they name none.
pub fn run(args: &Args) -> Option<Result<(), Failure>> {
    let file = args.preset.experiment.as_deref();
    let (name, refuses) = match (args.preset.preset, file) {
        (Some(preset), _) => (format!("--preset {}", setup::name(&preset)), preset.refuses()),
        (None, Some(_)) => ("--experiment".to_owned(), experiment::REFUSES),
        (None, None) => return None,
    };
    let typed = |id: &str| Given::here().and_then(|given| given.typed(id));
    let refusal = match refuses.iter().find_map(|id| typed(id)) {
        Some(option) => {
            anyhow!("{name} cannot be combined with {option}: leave one of them out")
        }
        None if typed("shot").is_some() && typed("shots").is_some() => anyhow!("give either SHOT or --shots, not both"),
        None => {
            return Some(args.preset.preset.map_or_else(
                || file.map_or(Ok(()), |path| experiment::run_file(args, path)),
                |preset| preset.run(args),
            ));
        }
    };
    Some(Err(Failure::Input(refusal)))
}
