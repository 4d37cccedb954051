//! Options of `diptych bench`, with those of its seam study and of its presets.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::anyhow;
use clap::ValueEnum;

use crate::cli::failure::Failure;
use crate::cli::options::{self, DenoiserChoice, RunOptions};
use crate::cli::reference::{PASS_SPP, seconds};
use crate::cli::setting_flags::{foveation, render_scale};
use crate::cli::settings::Given;
use crate::frame::settings::FoveationMode;
use crate::quality::{Denoiser, LogPolar};
use crate::report::once;
use crate::samples::Samples;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
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
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = options::denoiser_parser(), help_heading = options::QUALITY)]
    pub(super) denoiser: Vec<DenoiserChoice>,
    /// Iterations of denoisers to measure [default: 3,5]
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=i64::from(Denoiser::MAX_ITERATIONS)), help_heading = options::QUALITY)]
    pub(super) iterations: Vec<u32>,
    /// Foveation modes to measure [default: none]
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = foveation(), conflicts_with_all = ["seams", "study"], help_heading = options::QUALITY)]
    pub(super) foveation: Vec<FoveationMode>,
    /// Log-polar mode, e.g. fov, or SIGMA,ALPHA,GAZE,ASPECT [default: composite mode]
    ///
    /// Modes are fov, kernel, composite and composite-kernel. SIGMA: downsampling factor; ALPHA: kernel exponent; GAZE:
    /// full-resolution radius, radians; ASPECT: rings / directions.
    #[arg(long, value_name = "MODE", conflicts_with_all = ["seams", "study"], help_heading = options::QUALITY)]
    pub(super) polar: Option<LogPolar>,
    /// Render scales to measure [default: 1,0.7,0.5]
    ///
    /// Scales below 1 are measured only with the lowest sample count.
    #[arg(
        long = "render-scale",
        alias = "scale",
        value_delimiter = ',',
        value_name = "F,F,…",
        value_parser = render_scale,
        conflicts_with_all = ["seams", "study"], help_heading = options::QUALITY)]
    pub(super) scale: Vec<f64>,
    /// Also measure this ladder's rungs and their excess error (regret)
    ///
    /// Regret is the excess of a rung's error over that of the best setting that takes no longer, within 3 %.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seams", "study"], help_heading = options::QUALITY)]
    pub(super) ladder: Option<PathBuf>,
    /// Measure a small grid against a coarse reference
    #[arg(long, help_heading = options::QUALITY)]
    pub(super) quick: bool,
    /// Measure everything again instead of resuming
    #[arg(long, help_heading = options::OUTPUT)]
    pub(super) fresh: bool,
    /// Timed and compared frames per setting; the grid compares at least 2
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = options::SCENE)]
    pub(super) repeats: u32,
    /// Untimed frames before the timed ones
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = options::SCENE)]
    pub(super) warm_up: u32,
    /// Also report errors by kind of pixel: silhouettes, creases, reflections, …
    ///
    /// bench.csv then has the columns flip_KIND, the mean FLIP of the kind's pixels, and part_KIND, their part of the
    /// sum of FLIP over all pixels.
    #[arg(long, conflicts_with_all = ["seams", "study"], help_heading = options::QUALITY)]
    pub(super) by_kind: bool,
    /// Folder of left.exr and right.exr to compare with [default: render them]
    #[arg(
        long = "reference-images",
        alias = "reference",
        value_name = "DIR",
        conflicts_with_all = ["reference_spp", "reference_time_limit", "reference_dir"], help_heading = options::QUALITY)]
    pub(super) reference: Option<PathBuf>,
    /// Samples per pixel of the reference [default: 1024, with --quick 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2 * i64::from(PASS_SPP)..), help_heading = options::QUALITY)]
    pub(super) reference_spp: Option<u32>,
    /// Time limit of the reference, seconds; later runs resume it
    #[arg(long, default_value = "600", value_name = "S", value_parser = seconds, help_heading = options::QUALITY)]
    pub(super) reference_time_limit: Duration,
    /// Folder of references for later runs [default: reference in --out]
    #[arg(long = "reference-cache", alias = "reference-dir", value_name = "DIR", help_heading = options::OUTPUT)]
    pub(super) reference_dir: Option<PathBuf>,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    pub(super) report: bool,
    /// With --report: other renderers' times and FLIP, as in docs/peers
    #[arg(long, value_name = "FILE", requires = "report", conflicts_with_all = ["seams", "study"], help_heading = options::OUTPUT)]
    pub(super) peers: Option<PathBuf>,
    #[command(flatten)]
    pub(super) seams: SeamOptions,
    #[command(flatten)]
    pub(super) preset: PresetOptions,
}

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = options::QUALITY)]
pub struct SeamOptions {
    /// Measure seams instead of the grid: every seam policy at every count
    ///
    /// It uses the first value of --spp, --bounces, --denoiser and --iterations.
    #[arg(long = "seam-study", alias = "seams", conflicts_with_all = ["virtual_devices", "seam"])]
    seams: bool,
    /// With --seam-study: virtual devices on each adapter
    #[arg(long, value_delimiter = ',', default_value = "2,3,4", value_name = "N,N,…", requires = "seams", value_parser = clap::value_parser!(u16).range(1..=64))]
    counts: Vec<u16>,
}

impl SeamOptions {
    pub fn is_wanted(&self) -> bool {
        self.seams
    }

    /// Returns the counts above 1, which have seams.
    pub(super) fn counts(&self) -> Vec<u16> {
        self.counts.iter().copied().filter(|count| *count > 1).collect()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Preset {
    /// Leria et al.: distribute every stage, or only path tracing
    Leria,
    /// Xu, Tong & Xu: bmfr with and without feature noise, and svgf
    Bmfr,
    /// Koskela et al.: visual-polar space against equal-sample alternatives
    Koskela,
    /// Andersson & Hansson: four log-polar modes, by rings around the gaze
    Andersson,
    /// Peres: foveated sampling and denoising in layers
    Peres,
    /// Late reprojection of frames 1, 2 and 4 periods late (needs --motion)
    Late,
}

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = options::QUALITY)]
pub struct PresetOptions {
    /// Repeat a published experiment instead of the grid
    #[arg(long, value_name = "NAME", group = "study", conflicts_with_all = ["seams", "spp", "bounces", "denoiser", "iterations", "reference"])]
    pub(super) preset: Option<Preset>,
    /// Run the experiment in a TOML file instead of the grid
    ///
    /// docs/experiments.md describes such files.
    #[arg(
        long,
        value_name = "FILE",
        group = "study",
        conflicts_with_all = ["seams", "spp", "bounces", "denoiser", "iterations", "reference", "foveation", "polar", "scale", "ladder", "peers"])]
    pub(super) experiment: Option<PathBuf>,
    /// Shots to measure, for --experiment or any --preset but leria
    ///
    /// For peres they replace the scenes of the thesis: Pink Room, Sponza, Forest [default: builtin:checker,
    /// builtin:atrium and builtin:forest].
    #[arg(long, value_name = "SHOT,…", value_delimiter = ',', requires = "study")]
    pub shots: Vec<String>,
    /// Scale factor of the resolutions of --preset peres or of an --experiment
    #[arg(long, value_name = "F", requires = "study", default_value_t = 0.25, value_parser = size_factor)]
    pub size_factor: f64,
    /// Instants on the path, for --experiment, --preset peres, andersson or late
    #[arg(long, value_name = "N", requires = "study", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub instants: u32,
    /// Frames along the path, for --preset leria or an --experiment
    #[arg(long, value_name = "N", requires = "study", default_value_t = 104, value_parser = clap::value_parser!(u32).range(1..=5000))]
    pub frames: u32,
    /// Device counts to predict, for --preset leria or an --experiment
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", requires = "study", default_value = "4", value_parser = clap::value_parser!(u16).range(2..=64))]
    simulate: Vec<u16>,
}

fn size_factor(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok().filter(|factor: &f64| (0.01..=4.0).contains(factor));
    factor.ok_or_else(|| "give a number from 0.01 to 4".to_owned())
}

impl PresetOptions {
    /// Returns the device counts of --simulate without duplicates.
    pub fn simulated(&self) -> Vec<usize> {
        once(self.simulate.iter().copied().map(usize::from))
    }
}

/// Refuses the options with these field names if the command line has them. `name` is the option that selected the
/// experiment.
pub fn refuse(name: &str, options: impl IntoIterator<Item = &'static str>) -> Result<(), Failure> {
    let given = Given::here();
    match options.into_iter().find_map(|id| given?.typed(id)) {
        None => Ok(()),
        Some(option) => Err(Failure::Input(anyhow!("{name} cannot be combined with {option}: leave one of them out"))),
    }
}
