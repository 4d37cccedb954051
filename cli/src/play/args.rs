//! Options of `diptych play`.

use std::path::PathBuf;

use super::options::LoopOptions;
use crate::options::{OUTPUT, QUALITY, SCENE};

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Frames to render
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = SCENE)]
    pub(super) frames: u32,
    #[command(flatten)]
    pub options: LoopOptions,
    /// If nothing fits the budget at --size, play at a smaller size
    #[arg(long, help_heading = SCENE)]
    pub(super) fit: bool,
    /// Also write every Kth frame; the clock stops meanwhile
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..), help_heading = OUTPUT)]
    pub(super) save_every: Option<u32>,
    /// Also write report.html
    #[arg(long, help_heading = OUTPUT)]
    pub(super) report: bool,
    /// Repeat the decisions of an earlier run of the same shot, by its run.json
    ///
    /// Uses the ladder.toml beside it, and the run's frame rate, frames and scene cuts.
    #[arg(hide_short_help = true, long, value_name = "FILE", conflicts_with_all = ["fit", "ladder", "frames"], help_heading = QUALITY)]
    pub(super) replay: Option<PathBuf>,
}

impl Args {
    /// Returns the options of the control loop.
    pub(super) fn loop_options(&self) -> LoopOptions {
        let mut options = self.options.clone();
        options.run.makes_cuts = true;
        options
    }
}
