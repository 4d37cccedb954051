//! Options that the rendering commands share.

use std::ops::Deref;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use diptych::device::{ShaderChecks, TraversalChoice};
use diptych::graph::{HaloPlan, Seam};
use diptych::image::Extent;
use diptych::passes::Aov;
use diptych::quality::{Denoiser, Quality};
use diptych::report::once;
use diptych::schedule::RatioRule;
use diptych::stages::Sampler;

use super::faults::FaultOptions;
use super::foveation::FoveationOptions;
use super::scene_options::SceneOptions;

/// Sections of a command's help, in their order.
pub const SCENE: &str = "What to render";
pub const QUALITY: &str = "Quality";
pub const DEVICES: &str = "Devices";
pub const OUTPUT: &str = "Output";
pub const TESTS: &str = "For tests";

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Balance {
    /// The same rows for every device
    Even,
    /// By --ratios
    Static,
    /// By what past frames cost
    Measured,
    /// ... by list scheduling of blocks of rows
    Heft,
}

/// A denoiser or none. clap takes an `Option` by that name for an option that may be left out.
pub type DenoiserChoice = Option<Denoiser>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SeamOption {
    /// Stripes are filtered apart
    None,
    /// ... and smoothed where they meet
    Filter,
    /// Filters read across: the same bytes as one device
    Halo,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum HaloOption {
    /// Whatever costs less, for each iteration
    Cost,
    /// Receive a wide margin once, filter it oneself
    Recompute,
    /// Receive a narrow margin before every iteration
    Exchange,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    On,
    Off,
}

/// Options of every command that renders.
#[derive(Args, Clone, Debug)]
pub struct RunOptions {
    /// A shot (.toml), a .gltf/.glb, or builtin:NAME
    #[arg(default_value = "builtin:atrium")]
    pub shot: String,
    #[command(flatten)]
    pub scene: SceneOptions,
    /// Size of each eye, WIDTHxHEIGHT
    #[arg(long, default_value = "640x360", help_heading = SCENE)]
    pub size: Extent,
    /// Seconds along the camera path and the scene's animations
    #[arg(long, default_value_t = 0.0, value_name = "T", allow_negative_numbers = true, help_heading = SCENE)]
    pub time: f64,
    /// Head motion in place of the camera's path, as --record-motion of play and view leaves it: JSON lines
    #[arg(long, value_name = "FILE", help_heading = SCENE)]
    pub motion: Option<PathBuf>,
    #[arg(long, default_value_t = 0, help_heading = QUALITY)]
    pub seed: u32,
    #[arg(long, default_value = "sobol", help_heading = QUALITY)]
    pub sampler: Sampler,
    /// off: both eyes are fully traced
    #[arg(long, default_value = "on", help_heading = QUALITY)]
    pub reproject: Switch,
    /// Upper bound of indirect radiance; biased
    #[arg(long, value_name = "V", help_heading = QUALITY)]
    pub clamp: Option<f32>,
    /// Adapters by their number in `diptych devices` [default: all hardware GPUs, each once, else the software one]
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", help_heading = DEVICES)]
    pub devices: Option<Vec<usize>>,
    /// Worker threads of software devices, one number for all or one per device [default: cores / devices]
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "T,T,…",
        value_parser = clap::value_parser!(u16).range(1..=1024),
        help_heading = DEVICES
    )]
    pub threads_per_device: Option<Vec<u16>>,
    /// Work is handed to a device in portions predicted to take at most so many milliseconds, since systems reset devices
    /// that are at one for seconds [default: 200 on GPUs, no bound on software adapters]
    #[arg(long, value_name = "MS", value_parser = max_dispatch_ms, help_heading = DEVICES)]
    pub max_dispatch_ms: Option<f64>,
    /// How rays find what they meet [default: auto, and run.json tells what that came to]
    #[arg(long, default_value = "auto", hide_default_value = true, help_heading = DEVICES)]
    pub traversal: TraversalChoice,
    /// Rank 0 sends the scene's files to the other ranks, which then need none of their own
    #[cfg(feature = "mpi")]
    #[arg(long, help_heading = DEVICES)]
    pub broadcast_scene: bool,
    /// How stripes are cut [default: measured; static with --ratios]
    #[arg(long, help_heading = DEVICES)]
    pub balance: Option<Balance>,
    /// Share of rows per device, as 5,1,2; of a stage as atrous=1,1,2; of a stage and view as path_trace.left=5,1,2
    #[arg(long, value_name = "A,B,…", help_heading = DEVICES)]
    pub ratios: Vec<RatioRule>,
    /// What happens where stripes meet
    #[arg(long, default_value = "halo", help_heading = DEVICES)]
    pub seam: SeamOption,
    /// How halo rows come about
    #[arg(long, default_value = "cost", help_heading = DEVICES)]
    pub halo: HaloOption,
    /// Where results go; made if it is not there
    #[arg(long, value_name = "DIR", help_heading = OUTPUT)]
    pub out: PathBuf,
    /// Write a trace-file (Chrome trace events; opens in Perfetto)
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub trace: Option<PathBuf>,
    /// No progress
    #[arg(long, help_heading = OUTPUT)]
    pub quiet: bool,
    /// Progress and result as JSON lines
    #[arg(long, help_heading = OUTPUT)]
    pub json: bool,
    /// Keep the code that the scene does not need
    #[arg(long, help_heading = TESTS)]
    pub no_skip: bool,
    /// Run-time checks in shaders
    #[arg(long, default_value = "fast", help_heading = TESTS)]
    pub shader_checks: ShaderChecks,
    #[command(flatten)]
    pub faults: FaultOptions,
}

impl RunOptions {
    pub fn reprojects(&self) -> bool {
        self.reproject == Switch::On
    }

    pub fn seam(&self) -> Seam {
        match (self.seam, self.halo) {
            (SeamOption::None, _) => Seam::None,
            (SeamOption::Filter, _) => Seam::Filter,
            (SeamOption::Halo, HaloOption::Cost | HaloOption::Recompute) => Seam::Halo(HaloPlan::RECOMPUTE),
            (SeamOption::Halo, HaloOption::Exchange) => Seam::Halo(HaloPlan::EXCHANGE),
        }
    }

    /// Whether rank 0 sends the scene to others.
    pub fn broadcasts_scene(&self) -> bool {
        #[cfg(feature = "mpi")]
        return self.broadcast_scene;
        #[cfg(not(feature = "mpi"))]
        false
    }

    /// The balance asked for, or the one that --ratios imply.
    pub fn balance(&self) -> Balance {
        self.balance.unwrap_or(if self.ratios.is_empty() { Balance::Measured } else { Balance::Static })
    }

    /// What clap cannot see.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        anyhow::ensure!(self.time.is_finite(), "--time {} is not a number of seconds", self.time);
        if let Some(clamp) = self.clamp {
            anyhow::ensure!(clamp.is_finite() && clamp > 0.0, "--clamp {clamp} is not a radiance above 0");
        }
        anyhow::ensure!(
            self.balance() != Balance::Static || !self.ratios.is_empty(),
            "--balance static needs --ratios"
        );
        anyhow::ensure!(
            self.balance() == Balance::Static || self.ratios.is_empty(),
            "--ratios are for --balance static"
        );
        Ok(())
    }
}

/// Options of commands that render every frame alike.
#[derive(Args, Clone, Debug)]
pub struct RenderOptions {
    #[command(flatten)]
    pub run: RunOptions,
    /// Samples per pixel
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..), help_heading = QUALITY)]
    pub spp: u32,
    /// Reflections that light takes to the eye; direct light is always there, so 0 and 1 are alike
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(0..=1024), help_heading = QUALITY)]
    pub bounces: u32,
    /// Render scale, of the image's edges: paths are traced for its square's share of the pixels, and the denoiser brings
    /// light to the others
    #[arg(long = "render-scale", default_value_t = 1.0, value_name = "F", value_parser = render_scale, help_heading = QUALITY)]
    pub scale: f64,
    #[arg(long, default_value = "svgf", value_parser = Denoiser::value_parser(), help_heading = QUALITY)]
    pub denoiser: DenoiserChoice,
    #[command(flatten)]
    pub foveated: FoveationOptions,
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = SCENE)]
    pub frames: u32,
    /// Frames per second of the camera path
    #[arg(long, default_value_t = 72.0, help_heading = SCENE)]
    pub fps: f64,
    /// Frames on the devices at a time: more keep them busy, and each takes longer
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=3), help_heading = DEVICES)]
    pub frames_in_flight: u8,
    /// Auxiliary images to write
    #[arg(long, value_delimiter = ',', value_name = "LIST", help_heading = OUTPUT)]
    pub aov: Vec<Aov>,
    /// Whether frames are shown from another pose than they are rendered at.
    #[arg(skip)]
    pub is_late: bool,
}

impl Deref for RenderOptions {
    type Target = RunOptions;

    fn deref(&self) -> &RunOptions {
        &self.run
    }
}

pub fn render_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse().ok().filter(|scale| Quality::SCALES.contains(scale));
    scale.ok_or_else(|| format!("give a number from {} to {}", Quality::SCALES.start(), Quality::SCALES.end()))
}

fn max_dispatch_ms(text: &str) -> Result<f64, String> {
    let ms = text.parse().ok().filter(|ms: &f64| ms.is_finite() && *ms > 0.0);
    ms.ok_or_else(|| "give a number of milliseconds above 0".to_owned())
}

/// Most samples of one frame; beyond, they are taken in passes.
const MAX_FRAME_SPP: u32 = 1 << 20;

impl RenderOptions {
    /// One frame of this quality, with [`FoveationOptions::for_quality`].
    pub fn single(run: RunOptions, quality: &Quality) -> Self {
        let Quality { spp, bounces, denoiser, scale, .. } = *quality;
        let foveated = FoveationOptions::for_quality(quality);
        let (frames, fps, frames_in_flight, aov) = (1, 1.0, 1, Vec::new());
        Self { run, spp, bounces, scale, denoiser, foveated, frames, fps, frames_in_flight, aov, is_late: false }
    }

    /// What every frame is rendered with: without iterations there is no denoiser.
    pub fn quality(&self) -> Quality {
        let Self { spp, bounces, denoiser, ref foveated, scale, .. } = *self;
        let iterations = denoiser.map_or([0; 3], |d| foveated.layer_iterations().map(|n| n.min(d.most_iterations())));
        let denoiser = denoiser.filter(|_| iterations != [0; 3]);
        let (fovea, polar) = (foveated.radii(), foveated.space());
        Quality { spp, bounces, denoiser, iterations, fovea, polar, scale }
    }

    /// The auxiliary images asked for, each once.
    pub fn aovs(&self) -> Vec<Aov> {
        once(self.aov.iter().copied())
    }

    /// What clap cannot see.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        anyhow::ensure!(self.fps.is_finite() && self.fps > 0.0, "--fps {} is not a rate above 0", self.fps);
        anyhow::ensure!(
            self.spp <= MAX_FRAME_SPP,
            "--spp {} is more than the {MAX_FRAME_SPP} of one frame: --reference takes them in passes",
            self.spp
        );
        if let Some(late) = self.faults.injections.iter().find(|i| i.frame >= self.frames) {
            anyhow::bail!(
                "--inject: there is no frame {}: the last of {} is {}",
                late.frame,
                self.frames,
                self.frames - 1
            );
        }
        anyhow::ensure!(
            self.scale == 1.0 || self.quality().denoiser.is_some(),
            "--render-scale below 1 needs a denoiser, that brings light to the pixels left out"
        );
        self.foveated.check(self.denoiser)?;
        self.run.check()
    }
}
