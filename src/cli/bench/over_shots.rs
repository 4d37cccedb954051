//! Runs an experiment on each of several shots.

use super::args::Args;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::RunOptions;
use crate::cli::output;
use crate::cli::progress::Progress;
use crate::cli::setup::Tracing;
use crate::report::once;

/// Calls `measure` for each shot that the options name. `frames` is the number of frames per shot, for the progress
/// bar.
pub fn over_shots(
    args: &Args,
    frames: u64,
    mut measure: impl FnMut(&Args, &Progress, &Tracing) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let shots = if args.preset.shots.is_empty() { vec![options.shot.clone()] } else { once(args.preset.shots.clone()) };
    let progress = Progress::new(shots.len() as u64 * frames, options.quiet, options.json);
    for shot in shots {
        let run = RunOptions { shot, ..options.clone() };
        measure(&Args { options: run, ..args.clone() }, &progress, &tracing)?;
    }
    progress.finish();
    tracing.finish()
}
