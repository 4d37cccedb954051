//! Options of `diptych play`.

use std::path::PathBuf;

use super::options::LoopOptions;
use crate::options::{OUTPUT, QUALITY, SCENE};
use diptych::control::ControllerKind;

#[derive(clap::Args, Clone, Debug)]
#[command(mut_arg("disturbances", |option| option.hide_short_help(false)))]
pub struct Args {
    #[command(flatten)]
    pub options: LoopOptions,
    /// Frames to render
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = SCENE)]
    pub(super) frames: u32,
    /// If nothing fits the budget at --size, play at a smaller size
    #[arg(long, help_heading = SCENE)]
    pub(super) fit: bool,
    /// Also write every Kth frame; the clock stops meanwhile
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..), help_heading = OUTPUT)]
    pub(super) save_every: Option<u32>,
    /// Also write report.html
    #[arg(long, help_heading = OUTPUT)]
    pub(super) report: bool,
    /// Also write each task to run.json
    #[arg(long, help_heading = OUTPUT)]
    pub(super) details: bool,
    /// Repeat the decisions of an earlier run of the same shot, by its run.json
    ///
    /// Uses the ladder.toml beside it, and the run's frame rate, frames and scene cuts.
    #[arg(hide_short_help = true, long, value_name = "FILE", conflicts_with_all = ["fit", "ladder", "frames"], help_heading = QUALITY)]
    pub(super) replay: Option<PathBuf>,
    /// Compare these controllers: play with each in turns
    ///
    /// Names are those of the setting controller. Writes a folder per run, comparison.csv and comparison.svg.
    #[arg(hide_short_help = true, long, value_delimiter = ',', value_name = "NAME,…", conflicts_with_all = ["report", "save_every", "trace", "record_motion", "replay"], help_heading = OUTPUT)]
    pub(super) compare_control: Vec<ControllerKind>,
    /// Runs per controller, for --compare-control
    #[arg(hide_short_help = true, long, value_name = "N", default_value_t = 3, requires = "compare_control", value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = OUTPUT)]
    pub(super) runs: u32,
    /// Reference samples per pixel [default: for --report, as many as 10 s allow]
    ///
    /// For --compare-control: 256 by default.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24), help_heading = OUTPUT)]
    pub(super) report_spp: Option<u32>,
}

impl Args {
    /// Returns the options of the control loop.
    pub(super) fn loop_options(&self) -> LoopOptions {
        let mut options = self.options.clone();
        options.run.faults.makes_cuts = true;
        options
    }
}
