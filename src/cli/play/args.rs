//! Options of `diptych play`.

use super::disturb::Disturbance;
use super::options::LoopOptions;
use crate::cli::options::{OUTPUT, SCENE, TESTS};

#[derive(clap::Args, Clone, Debug)]
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
    /// Disturb the run: slow:devI@FROM..TO or scene-cut@FRAME
    #[arg(long, value_name = "WHAT@WHEN", help_heading = TESTS)]
    pub(super) disturb: Vec<Disturbance>,
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
