//! `diptych bench --preset`: published experiments, one module each.
//!
//! To add an experiment, write a module with `run` and `REFUSES`, add a variant to [`Experiment`] and a line to each of
//! its methods.

use anyhow::anyhow;

use super::args::{Args, Experiment};
use super::{andersson, bmfr, koskela, late, leria, peres};
use crate::cli::failure::Failure;
use crate::cli::settings::Given;
use crate::cli::setup;

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

/// Runs the experiment that the options name; `None` if they name none.
pub fn run(args: &Args) -> Option<Result<(), Failure>> {
    let experiment = args.preset.preset?;
    let typed = |id: &str| Given::here().and_then(|given| given.typed(id));
    let refusal = match experiment.refuses().iter().find_map(|id| typed(id)) {
        Some(option) => {
            let name = setup::name(&experiment);
            anyhow!("--preset {name} cannot be combined with {option}: leave one of them out")
        }
        None if typed("shot").is_some() && typed("shots").is_some() => anyhow!("give either SHOT or --shots, not both"),
        None => return Some(experiment.run(args)),
    };
    Some(Err(Failure::Input(refusal)))
}
