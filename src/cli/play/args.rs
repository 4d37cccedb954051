//! Options of `diptych play`.

use super::options::LoopOptions;
use crate::cli::options::{OUTPUT, SCENE};

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
    /// Play on if the first 30 frames show that nothing fits the budget
    #[arg(long, help_heading = SCENE)]
    pub(super) keep_going: bool,
    /// Also write every Kth frame; the clock stops meanwhile
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..), help_heading = OUTPUT)]
    pub(super) save_every: Option<u32>,
    /// Also write report.html
    #[arg(long, help_heading = OUTPUT)]
    pub(super) report: bool,
    /// Also write each task to run.json
    #[arg(long, help_heading = OUTPUT)]
    pub(super) details: bool,
    /// Reference samples per pixel, for --report [default: as many as 10 s allow]
    #[arg(long, value_name = "N", requires = "report", value_parser = clap::value_parser!(u32).range(1..=1 << 24), help_heading = OUTPUT)]
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
