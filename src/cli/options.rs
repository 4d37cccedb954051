//! Options that the rendering commands share.

use std::ops::Deref;
use std::path::{Path, PathBuf};

use clap::{Parser, ValueEnum};

use crate::device::{ShaderChecks, TraversalChoice};
use crate::frame::{Foveation, Sampler};
use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;
use crate::passes::Aov;
use crate::quality::{Denoiser, Envelope, Filter, Quality};
use crate::report::once;
use crate::samples::Samples;
use crate::scene::shot::Gaze;
use crate::schedule::RatioRule;

use super::balance::Balance;
pub use super::denoisers::{DenoiserChoice, denoiser_parser};
use super::fault_options::FaultOptions;
use super::foveation::FoveationFlags;
pub use super::headings::{DEVICES, OUTPUT, QUALITY, SCENE, TESTS};
use super::scene_options::SceneOptions;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SeamOption {
    /// Filter stripes separately
    None,
    /// Filter stripes separately and smooth the seams
    Filter,
    /// Filter across stripes: the same bytes as one device
    Halo,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum HaloOption {
    /// Choose the cheaper of recompute and exchange for each iteration
    Cost,
    /// Receive a wide margin once and filter it redundantly
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
#[derive(Parser, Clone, Debug)]
pub struct RunOptions {
    /// A shot (.toml), a .gltf/.glb, or builtin:NAME
    #[arg(default_value = "builtin:atrium")]
    pub shot: String,
    #[command(flatten)]
    pub scene: SceneOptions,
    /// Size of each eye in pixels, WIDTHxHEIGHT
    #[arg(long, default_value = "640x360", help_heading = SCENE)]
    pub size: Extent,
    /// Time on the camera path and in animations, seconds
    #[arg(hide_short_help = true, long, default_value_t = 0.0, value_name = "T", allow_negative_numbers = true, help_heading = SCENE)]
    pub time: f64,
    /// Replay head motion from FILE instead of the camera path
    ///
    /// `play` and `view` record such files with --record-motion. They are JSON lines of head poses, and of the eyes'
    /// projections if these are asymmetric.
    #[arg(hide_short_help = true, long, value_name = "FILE", help_heading = SCENE)]
    pub motion: Option<PathBuf>,
    /// Seed of all random numbers
    #[arg(hide_short_help = true, long, default_value_t = 0, help_heading = QUALITY)]
    pub seed: u32,
    /// Random number generator
    #[arg(hide_short_help = true, long, default_value = "sobol", help_heading = QUALITY)]
    pub sampler: Sampler,
    /// Reproject the right eye from the left one; off traces both eyes in full
    #[arg(long, default_value = "on", help_heading = QUALITY)]
    pub reproject: Switch,
    /// Filter the left eye's light and reproject the result, for svgf
    ///
    /// Both eyes then see the same noise. With off, the right eye takes over the left eye's samples and filters them.
    #[arg(hide_short_help = true, long, default_value = "on", help_heading = QUALITY)]
    pub filter_once: Switch,
    /// Keep direct light with hard shadows out of the denoiser, for up to 4 lights
    ///
    /// Points and spots without a radius and suns with a radius of at most 1 degree have hard shadows.
    #[arg(hide_short_help = true, long, default_value = "on", help_heading = QUALITY)]
    pub hard_shadows: Switch,
    /// Denoise what mirrors and clear glass show, not their own surfaces
    #[arg(hide_short_help = true, long, default_value = "on", help_heading = QUALITY)]
    pub follow_mirrors: Switch,
    /// Roughen narrow lobes behind diffuse bounces in denoised frames (biased)
    ///
    /// Caustics are blurred and fireflies vanish. The bias shrinks with the number of samples.
    #[arg(hide_short_help = true, long, default_value = "on", help_heading = QUALITY)]
    pub regularize: Switch,
    /// Average base colour textures over each pixel in denoised frames of 1 spp
    ///
    /// Frames of several samples average them by their samples.
    #[arg(hide_short_help = true, long, default_value = "on", help_heading = QUALITY)]
    pub filter_textures: Switch,
    /// End paths in a cache of the light of earlier frames (biased)
    ///
    /// Needs a denoiser that keeps a history, two bounces or more, and a scene in which only the camera moves. References
    /// never use it. It saves more time with more samples and bounces, and none around an object in the studio, whose
    /// light comes directly. [default: on; off for objects on the studio's ground]
    #[arg(hide_short_help = true, long, help_heading = QUALITY)]
    pub cache: Option<Switch>,
    /// Upper bound of indirect radiance (biased)
    #[arg(hide_short_help = true, long, value_name = "V", help_heading = QUALITY)]
    pub clamp: Option<f32>,
    /// Adapters by number in `diptych devices` [default: all hardware GPUs]
    ///
    /// Each GPU is used once, even if several APIs list it. Without a hardware GPU the software adapter is used.
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", help_heading = DEVICES)]
    pub devices: Option<Vec<usize>>,
    /// Threads per software device, one number or a list [default: cores / devices]
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "T,T,…",
        value_parser = clap::value_parser!(u16).range(1..=1024),
        help_heading = DEVICES
    )]
    pub threads_per_device: Option<Vec<u16>>,
    /// Value of [`crate::device::Selection::most_virtual_devices`].
    #[arg(skip)]
    pub most_virtual_devices: u16,
    /// Longest predicted submission, ms [default: 200 on GPUs, none on CPUs]
    ///
    /// Longer work is split, because GPU watchdogs (TDR on Windows) reset devices that are busy for seconds.
    #[arg(hide_short_help = true, long, value_name = "MS", value_parser = max_dispatch_ms, help_heading = DEVICES)]
    pub max_dispatch_ms: Option<f64>,
    /// Ray traversal by compute shaders or ray queries [default: automatic choice]
    ///
    /// run.json records the choice.
    #[arg(hide_short_help = true, long, default_value = "auto", hide_default_value = true, help_heading = DEVICES)]
    pub traversal: TraversalChoice,
    /// Send the files of the scene from rank 0 to all other ranks
    #[cfg(feature = "mpi")]
    #[arg(hide_short_help = true, long, help_heading = DEVICES)]
    pub broadcast_scene: bool,
    /// Load-balancing policy [default: measured; static with --ratios]
    ///
    /// `scale` compares several.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = Balance::value_parser(), help_heading = DEVICES)]
    pub balance: Vec<Balance>,
    /// Ratios of rows per device: 5,1,2, or GROUP[.EYE]=5,1,2 for a group of passes
    ///
    /// GROUP is path_trace, denoise or another group of passes, and EYE is left or right: path_trace.left=1,2. Repeat
    /// the option for several groups.
    #[arg(long, value_name = "A,B,…", help_heading = DEVICES)]
    pub ratios: Vec<RatioRule>,
    /// Filtering across stripes
    #[arg(long, default_value = "halo", help_heading = DEVICES)]
    pub seam: SeamOption,
    /// Source of the rows that filters read around a stripe
    #[arg(hide_short_help = true, long, default_value = "cost", help_heading = DEVICES)]
    pub halo: HaloOption,
    /// Folder for all output files; created if missing
    #[arg(long, value_name = "DIR", help_heading = OUTPUT)]
    pub out: PathBuf,
    /// Write a trace for Perfetto (Chrome trace events)
    #[arg(long, value_name = "FILE", help_heading = OUTPUT)]
    pub trace: Option<PathBuf>,
    /// Print no progress
    #[arg(long, help_heading = OUTPUT)]
    pub quiet: bool,
    /// Print progress and results as JSON lines
    #[arg(hide_short_help = true, long, help_heading = OUTPUT)]
    pub json: bool,
    /// Compile in shader code that the scene does not need
    #[arg(hide_short_help = true, long, help_heading = TESTS)]
    pub no_skip: bool,
    /// Run-time checks in shaders
    #[arg(hide_short_help = true, long, default_value = "fast", help_heading = TESTS)]
    pub shader_checks: ShaderChecks,
    #[command(flatten)]
    pub faults: FaultOptions,
}

impl RunOptions {
    /// Sets the folder for output files to `out/` and the name of the shot.
    pub fn choose_out(&mut self) {
        let name = self.shot.strip_prefix("builtin:").unwrap_or(&self.shot);
        self.out = Path::new("out").join(Path::new(name).file_stem().unwrap_or("scene".as_ref()));
    }

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

    /// True if rank 0 sends the scene's files to the other ranks.
    pub fn broadcasts_scene(&self) -> bool {
        #[cfg(feature = "mpi")]
        return self.broadcast_scene;
        #[cfg(not(feature = "mpi"))]
        false
    }

    /// Returns the requested policy or the default one.
    pub fn balance(&self) -> Balance {
        self.balances()[0]
    }

    /// Returns the requested policies without duplicates, or the default one: `static` with --ratios, else `measured`.
    pub fn balances(&self) -> Vec<Balance> {
        match &self.balance[..] {
            [] if self.ratios.is_empty() => vec![Balance::Measured],
            [] => vec![Balance::Static],
            asked => once(asked.iter().copied()),
        }
    }

    /// Checks constraints that clap cannot express.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        anyhow::ensure!(self.time.is_finite(), "--time {} is not a number of seconds", self.time);
        if let Some(clamp) = self.clamp {
            anyhow::ensure!(clamp.is_finite() && clamp > 0.0, "--clamp {clamp} is not a radiance above 0");
        }
        anyhow::ensure!(self.balances().len() == 1, "--balance: give one policy; `diptych scale` compares several");
        anyhow::ensure!(
            self.balance() != Balance::Static || !self.ratios.is_empty(),
            "--balance static needs --ratios"
        );
        anyhow::ensure!(self.balance() == Balance::Static || self.ratios.is_empty(), "--ratios needs --balance static");
        Ok(())
    }
}

/// Flags of commands that render all frames at the same quality.
#[derive(Parser, Clone, Debug)]
pub struct RenderFlags {
    #[command(flatten)]
    pub run: RunOptions,
    /// Samples per pixel, such as 2 or 1.25
    ///
    /// Between two whole numbers, each tile of 8x4 pixels takes one of them.
    #[arg(long, default_value = "1", value_name = "N", value_parser = spp, help_heading = QUALITY)]
    pub spp: Samples,
    /// Maximum bounces
    ///
    /// Direct light is always included, so 0 and 1 are equivalent.
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u32).range(0..=1024), help_heading = QUALITY)]
    pub bounces: u32,
    /// Per-axis render scale, 0.1 to 1
    ///
    /// F² of the pixels are path traced and the denoiser fills in the rest.
    #[arg(long = "render-scale", alias = "scale", default_value_t = 1.0, value_name = "F", value_parser = render_scale, help_heading = QUALITY)]
    pub scale: f64,
    /// Denoiser
    #[arg(long, default_value = "svgf", value_parser = denoiser_parser(), help_heading = QUALITY)]
    pub denoiser: DenoiserChoice,
    #[command(flatten)]
    pub foveated: FoveationFlags,
    /// Frames to render
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = SCENE)]
    pub frames: u32,
    /// Frames per second of the camera path
    #[arg(long, default_value_t = 72.0, help_heading = SCENE)]
    pub fps: f64,
    /// Frames in flight, 1 to 3: more throughput, more latency
    #[arg(hide_short_help = true, long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=3), help_heading = DEVICES)]
    pub frames_in_flight: u8,
    /// Auxiliary images (AOVs) to write, such as albedo,normal
    #[arg(long, value_delimiter = ',', value_name = "LIST", help_heading = OUTPUT)]
    pub aov: Vec<Aov>,
}

impl RenderFlags {
    /// Checks the flags and returns the options that they ask for.
    pub fn options(&self) -> Result<RenderOptions, anyhow::Error> {
        anyhow::ensure!(
            self.spp.least <= MAX_FRAME_SPP,
            "--spp {} exceeds the limit of {MAX_FRAME_SPP} per frame: use --reference to accumulate more",
            self.spp
        );
        self.foveated.check(self.denoiser)?;
        let options = RenderOptions {
            gaze: self.foveated.gaze(),
            frames: self.frames,
            fps: self.fps,
            frames_in_flight: self.frames_in_flight,
            aovs: once(self.aov.iter().copied()),
            ..RenderOptions::new(self.run.clone(), self.quality())
        };
        options.check()?;
        Ok(options)
    }

    /// Returns the quality of every frame. If all layers have 0 iterations, there is no filter.
    fn quality(&self) -> Quality {
        let Self { spp, bounces, denoiser, ref foveated, scale, .. } = *self;
        let most = denoiser.map_or(0, Denoiser::most_iterations);
        let filter = Filter::in_effect(denoiser, foveated.layer_iterations().map(|n| n.min(most)));
        let (fovea, polar) = (foveated.foveation.radii(), foveated.space());
        Quality { spp, bounces, filter, fovea, polar, scale }
    }
}

/// Options of a run, and the settings that all its frames share.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    pub run: RunOptions,
    /// Bounds of the qualities of frames. Most commands render all frames at the upper bound.
    pub envelope: Envelope,
    /// Fraction of the outer foveal layer's pixels that is not sampled.
    pub unsampled_fraction: f64,
    /// Gaze of the left and the right eye, in place of the shot's.
    pub gaze: Option<[Gaze; 2]>,
    pub frames: u32,
    pub fps: f64,
    pub frames_in_flight: u8,
    /// Auxiliary images, without duplicates.
    pub aovs: Vec<Aov>,
    /// True if late reprojection shows frames from a later pose than the one they were rendered from.
    pub is_late: bool,
}

impl RenderOptions {
    /// Returns the options of one frame.
    pub fn new(run: RunOptions, envelope: impl Into<Envelope>) -> Self {
        Self {
            run,
            envelope: envelope.into(),
            unsampled_fraction: Foveation::UNSAMPLED_FRACTION,
            gaze: None,
            frames: 1,
            fps: 1.0,
            frames_in_flight: 1,
            aovs: Vec::new(),
            is_late: false,
        }
    }

    /// Returns the highest quality of frames, which is that of all frames unless they vary.
    pub fn quality(&self) -> Quality {
        self.envelope.most
    }

    /// Checks constraints that clap cannot express.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        anyhow::ensure!(self.fps.is_finite() && self.fps > 0.0, "--fps {} is not a rate above 0", self.fps);
        self.faults.check(self.frames)?;
        self.quality().check()?;
        self.run.check()
    }
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

/// Parses a number of samples per pixel.
pub fn spp(text: &str) -> Result<Samples, String> {
    text.parse()
}

/// Parses a number of samples per pixel that a single frame may have.
pub fn frame_spp(text: &str) -> Result<Samples, String> {
    let spp = spp(text)?;
    spp.check().map(|()| spp).map_err(|error| error.to_string())
}

/// Maximum samples per pixel of one frame; --reference accumulates more in passes.
const MAX_FRAME_SPP: u32 = *Samples::VALID.end();
