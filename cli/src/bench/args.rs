//! Options of `diptych bench`.

use std::path::PathBuf;

use crate::options::{self, RunOptions};
use crate::reference::PASS_SPP;
use crate::report::bench::METRICS;
use crate::setting_flags::{named, render_scale};
use diptych::frame::settings::FoveationMode;
use diptych::quality::{Denoiser, DenoiserChoice};
use diptych::samples::Samples;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Compared frames per setting, at least 2
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = options::SCENE)]
    pub(super) repeats: u32,
    /// Turns in which all settings are timed, a frame each
    ///
    /// In a turn, each setting renders a frame before any is timed again, so that other load on the machine affects
    /// all settings alike. The front has only settings that differ by more than the 95 % intervals over turns.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..=1000), help_heading = options::SCENE)]
    pub(super) turns: u32,
    /// Untimed frames before the timed or compared ones
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = options::SCENE)]
    pub(super) warm_up: u32,
    #[command(flatten)]
    pub options: RunOptions,
    /// Virtual devices on each adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    pub(super) virtual_devices: u16,
    /// Samples per pixel to measure [default: 1,2,4,8,16]
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = options::frame_spp, help_heading = options::QUALITY)]
    pub(super) spp: Vec<Samples>,
    /// Maximum bounces to measure [default: 2,6]
    ///
    /// The reference uses the largest of these numbers.
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(0..=1024), help_heading = options::QUALITY)]
    pub(super) bounces: Vec<u32>,
    /// Denoisers to measure [default: none,atrous,svgf]
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = named::<DenoiserChoice>(), help_heading = options::QUALITY)]
    pub(super) denoiser: Vec<DenoiserChoice>,
    /// Iterations of denoisers to measure [default: 3,5]
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=i64::from(Denoiser::MAX_ITERATIONS)), help_heading = options::QUALITY)]
    pub(super) iterations: Vec<u32>,
    /// Foveation modes to measure [default: none]
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = named::<FoveationMode>(), help_heading = options::QUALITY)]
    pub(super) foveation: Vec<FoveationMode>,
    /// Render scales to measure [default: 1,0.7,0.5]
    ///
    /// Scales below 1 are measured only with the lowest sample count.
    #[arg(
        long = "render-scale",
        alias = "scale",
        value_delimiter = ',',
        value_name = "F,F,…",
        value_parser = render_scale,
        help_heading = options::QUALITY)]
    pub(super) scale: Vec<f64>,
    /// Also measure this ladder's rungs and their excess error (regret)
    ///
    /// Regret is the excess of a rung's error over that of the best setting that takes no longer, within 3 %.
    #[arg(long, value_name = "FILE", help_heading = options::QUALITY)]
    pub(super) ladder: Option<PathBuf>,
    /// Measure a small grid against a coarse reference
    #[arg(long, help_heading = options::QUALITY)]
    pub(super) quick: bool,
    /// Folder of left.exr and right.exr to compare with [default: render them]
    #[arg(
        long = "reference-images",
        alias = "reference",
        value_name = "DIR",
        conflicts_with_all = ["reference_spp", "reference_dir"], help_heading = options::QUALITY)]
    pub(super) reference: Option<PathBuf>,
    /// Samples per pixel of the reference [default: 1024, with --quick 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2 * i64::from(PASS_SPP)..), help_heading = options::QUALITY)]
    pub(super) reference_spp: Option<u32>,
    /// Folder of references for later runs [default: reference in --out]
    #[arg(long = "reference-cache", alias = "reference-dir", value_name = "DIR", help_heading = options::OUTPUT)]
    pub(super) reference_dir: Option<PathBuf>,
    /// Error that bench.svg plots over time [default: relmse]
    #[arg(long, default_value = "relmse", hide_default_value = true, value_parser = METRICS, help_heading = options::OUTPUT)]
    pub(super) metric: String,
    /// Also write bench.tex, the table in LaTeX
    #[arg(long, help_heading = options::OUTPUT)]
    pub(super) latex: bool,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    pub(super) report: bool,
}
