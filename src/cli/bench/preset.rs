//! `diptych bench --preset` and `--experiment`: published experiments and your own.
//!
//! To add a preset, write a file in `experiments` and add a variant to [`Preset`] and a line to its method.

use anyhow::anyhow;

use super::args::{Args, Preset};
use super::experiment;
use crate::cli::failure::Failure;
use crate::cli::settings::Given;

/// Experiment files of the presets, as text.
const ANDERSSON: &str = include_str!("experiments/andersson.toml");
const BMFR: &str = include_str!("experiments/bmfr.toml");
const KOSKELA: &str = include_str!("experiments/koskela.toml");
const LATE: &str = include_str!("experiments/late.toml");
const LERIA: &str = include_str!("experiments/leria.toml");
const PERES: &str = include_str!("experiments/peres.toml");

impl Preset {
    fn run(self, args: &Args) -> Result<(), Failure> {
        match self {
            Self::Leria => experiment::run_text(args, LERIA, "--preset leria"),
            Self::Bmfr => experiment::run_text(args, BMFR, "--preset bmfr"),
            Self::Koskela => experiment::run_text(args, KOSKELA, "--preset koskela"),
            Self::Andersson => experiment::run_text(args, ANDERSSON, "--preset andersson"),
            Self::Peres => experiment::run_text(args, PERES, "--preset peres"),
            Self::Late => experiment::run_text(args, LATE, "--preset late"),
        }
    }
}

/// Runs the experiment that the options name; `None` if they name none.
pub fn run(args: &Args) -> Option<Result<(), Failure>> {
    let is_named = args.preset.preset.is_some() || args.preset.experiment.is_some();
    let is_typed = |id: &str| Given::here().is_some_and(|given| given.typed(id).is_some());
    if is_named && is_typed("shot") && is_typed("shots") {
        return Some(Err(Failure::Input(anyhow!("give either SHOT or --shots, not both"))));
    }
    let file = args.preset.experiment.as_deref().map(|path| experiment::run_file(args, path));
    args.preset.preset.map(|preset| preset.run(args)).or(file)
}
