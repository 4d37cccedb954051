//! Settings of a run, in one table that flags, `--set`, shots, Python's keywords and `run.json` read.

mod check;
mod chosen;
mod needs;
mod overrides;
mod quality;
mod scene_value;
mod table;
mod value;
mod words;

use std::path::PathBuf;
use std::time::Duration;

use glam::DVec3;

use super::{Disturbance, Foveation, Sampler};
use crate::control::ControllerKind;
use crate::device::{ShaderChecks, TraversalChoice};
use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;
use crate::image::tone::ToneCurve;
use crate::passes::Aov;
use crate::projection::LogPolar;
use crate::quality::Denoiser;
use crate::samples::Samples;
use crate::scene::budget::ByteSize;
use crate::scene::motion::play::Choice;
use crate::scene::shot::{Exposure, Gaze, ShotEnvironment};
use crate::scene::viewpoint::Orbit;
use crate::schedule::{Balance, RatioRule};

pub use chosen::Chosen;
pub use scene_value::EyePoints;
pub use table::{CONTACT_SHEET, Group, NO_SHOT, Setting};
pub use value::{Value, Word, text_of};
pub use words::{FoveationMode, HaloMode, SeamMode};

table::settings! {
    Scene {
        /// Position of the eyes, scene units [default: the camera]
        ///
        /// Without a camera in the shot or the scene file, diptych chooses a viewpoint.
        position: Option<DVec3> = None;
        /// Point that the eyes look at, scene units
        target: Option<DVec3> = None;
        /// Camera of the scene file, from 0 [default: the first one]
        camera: Option<u32> = None;
        /// Vertical field of view, degrees [default: the camera's]
        yfov: Option<f64> = None;
        /// Number of views, side by side [default: the shot's, else 2, the eyes]
        ///
        /// Images of other than two views are called view00, view01 and so on, from left to right.
        views: Option<u32> = None, of ROWS;
        /// Views to path trace, an odd number
        ///
        /// Other views are reprojected from the nearest of them.
        sources: u32 = 1, of ROWS;
        /// Distance of neighbouring views, metres [default: the shot's, else 0.064]
        baseline: Option<f64> = None;
        /// Distance of zero parallax, metres [default: the shot's, else infinite]
        ///
        /// All views show the points at this distance at the same place.
        convergence: Option<f64> = None;
        /// Length of a scene unit, metres [default: the shot's, else 1]
        ///
        /// For files in millimetres, give 0.001.
        metres_per_unit: Option<f64> = None;
        /// View of the whole scene: front, three-quarter, top, AZ,EL or AZ,EL,ZOOM
        ///
        /// AZ is the azimuth in degrees: 0 is the front, +z, and 90 the side at +x. EL is the elevation, 90 above.
        /// Zoom 1 shows the whole scene; 2 shows it twice as large.
        orbit: Option<Orbit> = None;
        /// Exposure of pictures in stops, or auto; EXR files are not exposed
        ///
        /// auto meters a small frame before the run and prints the result. The default is the exposure of the shot, and
        /// auto for a glTF file. `scale` and `bench` use 0 instead of auto.
        exposure: Option<Exposure> = None;
        /// Tone curve of pictures [default: neutral for a glTF file, reinhard for a shot]
        ///
        /// Image metrics such as FLIP always use reinhard.
        tonemap: Option<ToneCurve> = None;
        /// Environment: studio, white, sky, an .hdr or .exr file, or a radiance R,G,B
        ///
        /// The default is the shot's. A glTF file without lights gets the studio: soft boxes, and a ground below an
        /// object. white is a radiance of 1 from all directions, which `export` uses instead of the studio.
        environment: Option<ShotEnvironment> = None;
        /// Animations to play: all, none, or a name [default: the shot's, else all]
        animation: Option<Choice> = None;
        /// Material variant of the scene file, by its name [default: its default look]
        variant: Option<String> = None;
        /// Time on the camera path and in animations, seconds
        time: f64 = 0.0;
        /// Frames per second of the path [default: 72; play and view: by the budget]
        fps: Option<f64> = None, of &["render", "scale", "play", "view"];
        /// Replay head motion from a file instead of the camera path
        ///
        /// `play` and `view` record such files with --record-motion. They are JSON lines of head poses, and of the
        /// eyes' projections if these are asymmetric.
        motion: Option<PathBuf> = None, of RUNS;
        /// Maximum host memory for the scene, such as 4GiB [default: half the RAM]
        max_scene_memory: Option<ByteSize> = None;
        /// Folder that keeps the trees of large scenes for later runs, or off
        ///
        /// Trees that take over a second to build are kept, up to 4 GiB in all. The default is diptych in the user's
        /// folder of caches.
        scene_cache: Option<PathBuf> = None;
        /// Allow shots and scenes to name files outside their folders
        allow_outside: bool = false;
        /// Refuse scenes with faulty textures or animations, instead of a warning
        strict: bool = false;
    }
    Run {
        /// Time limit of a picture or a reference, s [default: none; bench, study: 600]
        ///
        /// A single picture ends with the samples that it has, `spp_done` in run.json, of --spp (4096 if not given). A
        /// reference has at least one pass. Later runs with its passes_out, `bench` and `study` resume it.
        time_limit: Option<f64> = None, of &["render", "bench", "study"];
        /// Relative noise of a picture's samples, such as 0.05, which sets their number
        ///
        /// The noise is the root of relMSE that the samples have before the denoiser. A frame of a quarter of the width
        /// tells how many samples that takes. --spp is then the maximum.
        noise: Option<f64> = None, of &["render"];
        /// Folder that keeps the accumulation of --reference, to resume from it
        passes_out: Option<PathBuf> = None, of &["render"];
        /// Samples of --reference per pass, a power of two
        pass_spp: u32 = 8, of &["render"];
        /// Controller of the quality: diptych, vlachos, unreal, pid, pinned:N; or several
        ///
        /// `vlachos` is the adaptive quality of Vlachos (GDC 2016), `unreal` works like the dynamic resolution of
        /// Unreal Engine, `pid` is a PID controller, `pinned:N` stays on rung N, `turns:N` plays N frames on each rung
        /// in turn, and `turns:N:STEP` on every STEPth rung. `play` plays with several in turns and compares them: it
        /// writes a folder per run, comparison.csv and comparison.svg.
        controller: Vec<ControllerKind> = vec![ControllerKind::default()], of &["play", "view"];
        /// Runs of each controller
        runs: u32 = 3, needs several_controllers, of &["play"];
        /// Reference samples per pixel [default: for --report, as many as 10 s allow]
        ///
        /// To compare controllers: 256 by default.
        report_spp: Option<u32> = None, of &["play"];
        /// Also write each task to run.json
        details: bool = false, of &["play"];
        /// Also report errors by kind of pixel: silhouettes, creases, reflections, …
        ///
        /// bench.csv then has the columns flip_KIND, the mean FLIP of the kind's pixels, and part_KIND, their part of
        /// the sum of FLIP over all pixels.
        by_kind: bool = false, of &["bench"];
        /// Measure everything again instead of resuming
        fresh: bool = false, of &["bench"];
        /// File of other renderers' times and FLIP for --report, as in docs/results/peers
        peers: Option<PathBuf> = None, of &["bench"];
        /// Play on if the first 30 frames show that nothing fits the budget
        keep_going: bool = false, of &["play"];
        /// Relative speeds of simulated devices, repeated as needed
        speeds: Vec<f64> = vec![1.0], of &["scale"];
        /// Latency between simulated nodes, microseconds [default: as measured, else 2]
        network_us: Option<f64> = None, of &["scale"];
        /// Bandwidth between simulated nodes, Gbit/s [default: as measured, else 100]
        network_gbps: Option<f64> = None, of &["scale"];
        /// Repeat each device's work N times: one number, or one per device
        slowdown: Vec<u32> = Vec::new(), of RUNS;
        /// Drop a device that is silent for this time, ms [default: by frame times]
        ///
        /// A device is silent while its worker shows no progress. The default follows from the times of past frames; it
        /// is at least 10 s, or 0.6 s in play and view.
        watchdog_ms: Option<u32> = None, of RUNS;
        /// Auxiliary images (AOVs) of frames, such as albedo,normal
        aov: Vec<Aov> = Vec::new(), of &["render", "scale", "graph"];
    }
    Picture {
        /// Gaze as fractions of the image, X,Y or LX,LY,RX,RY [default: the shot's]
        gaze: Option<EyePoints> = None, needs foveated;
        /// Size of each eye in pixels, WIDTHxHEIGHT
        size: Extent = Extent::new(640, 360);
    }
    Quality {
        /// Samples per pixel, such as 2 or 1.25
        ///
        /// Between two whole numbers, each tile of 8x4 pixels takes one of them. A single picture has at least 16 samples
        /// per pixel in total, see --warm-up.
        spp: Samples = Samples::ONE, of FIXED;
        /// Maximum bounces
        ///
        /// Direct light is always included, so 0 and 1 are equivalent.
        bounces: u32 = 6, of FIXED;
        /// Per-axis render scale, 0.1 to 1
        ///
        /// F² of the pixels are path traced and the denoiser fills in the rest.
        render_scale: f64 = 1.0, needs filled, of FIXED;
        /// Denoiser
        denoiser: Option<Denoiser> = Some(Denoiser::SVGF), of SINGLE;
        /// Denoiser iterations, also per layer as M,N,P [default: 5; 2,3,5 with layers]
        iterations: Option<[u32; 3]> = None, needs denoiser, of SINGLE;
        /// First iterations of atrous that ignore differences in radiance
        ///
        /// Differences are mostly noise at one sample per pixel. Dammertz et al. 2010 compare radiance in all
        /// iterations: 0.
        blind_iterations: u32 = 3, needs atrous, of SINGLE;
        /// Foveated rendering
        foveation: FoveationMode = FoveationMode::None, of SINGLE;
        /// Log-polar mode, e.g. fov, or SIGMA,ALPHA,GAZE,ASPECT [default: composite mode]
        ///
        /// Modes are fov, kernel, composite and composite-kernel. SIGMA: downsampling factor; ALPHA: kernel exponent;
        /// GAZE: full-resolution radius, radians; ASPECT: rings / directions.
        polar: Option<LogPolar> = None, needs log_polar;
        /// Fraction of the outer foveal layer's pixels that is not sampled, 0 to 1
        unsampled_fraction: f64 = Foveation::UNSAMPLED_FRACTION, needs layers;
        /// Reproject the right eye; off traces both eyes in full
        reproject: bool = true;
        /// Filter the left eye's light and reproject the result, for svgf
        ///
        /// Both eyes then see the same noise. With off, the right eye takes over the left eye's samples and filters
        /// them.
        filter_once: bool = true, needs finished_light;
        /// Trace holes that several views share in one of them
        share_holes: bool = true, needs reprojected_views;
        /// Keep direct light with hard shadows out of the denoiser, for up to 4 lights
        ///
        /// Points and spots without a radius and suns with a radius of at most 1 degree have hard shadows.
        hard_shadows: bool = true, needs denoiser;
        /// Denoise what mirrors and clear glass show, not their own surfaces
        follow_mirrors: bool = true, needs denoiser;
        /// Keep specular light of narrow lobes out of denoisers that would blur it
        bypass_narrow_lobes: bool = true, needs denoiser;
        /// Roughen narrow lobes behind diffuse bounces in denoised frames (biased)
        ///
        /// Caustics are blurred and fireflies vanish. The bias shrinks with the number of samples.
        regularize: bool = true, needs denoiser;
        /// Average base colour textures over each pixel in denoised frames of 1 spp
        ///
        /// Frames of several samples average them by their samples.
        filter_textures: bool = true, needs denoiser;
        /// End paths in a cache of the light of earlier frames (biased)
        ///
        /// Needs a denoiser that keeps a history, two bounces or more, and a scene in which only the camera moves.
        /// References never use it. It saves more time with more samples and bounces, and none around an object in the
        /// studio, whose light comes directly. [default: on; off for objects on the studio's ground]
        cache: Option<bool> = None, needs history;
        /// Upper bound of indirect radiance (biased); 0 for none
        clamp: f32 = 0.0, needs indirect_light;
        /// Seed of all random numbers
        seed: u32 = 0;
        /// Random number generator
        sampler: Sampler = Sampler::Sobol;
    }
    Devices {
        /// Adapters by number in `diptych info` [default: all hardware GPUs]
        ///
        /// Each GPU is used once, even if several APIs list it. Without a hardware GPU the software adapter is used.
        devices: Vec<usize> = Vec::new(), of RUNS;
        /// Threads per software device, one number or a list [default: cores / devices]
        ///
        /// `scale` divides the cores by the largest number of devices.
        threads_per_device: Vec<u16> = Vec::new(), of RUNS;
        /// Load-balancing policy [default: measured; static with ratios]
        ///
        /// `scale` compares several.
        balance: Vec<Balance> = Vec::new(), of BALANCED;
        /// Ratios of rows per device: 5,1,2, or GROUP[.EYE]=5,1,2 for a group of passes
        ///
        /// GROUP is path_trace, denoise or another group of passes, and EYE is left or right: path_trace.left=1,2.
        /// Write a semicolon between several groups.
        ratios: Vec<RatioRule> = Vec::new(), needs static_balance, of BALANCED;
        /// Filtering across stripes
        seam: SeamMode = SeamMode::Halo;
        /// Source of the rows that filters read around a stripe
        halo: HaloMode = HaloMode::Cost, needs halos;
        /// Frames in flight, 1 to 3: more throughput, more latency
        frames_in_flight: u32 = 1, of FIXED;
        /// Longest predicted submission, ms [default: 200 on GPUs, none on CPUs]
        ///
        /// Longer work is split, because GPU watchdogs (TDR on Windows) reset devices that are busy for seconds.
        max_dispatch_ms: Option<f64> = None;
        /// Ray traversal by compute shaders or ray queries [default: automatic choice]
        ///
        /// run.json records the choice.
        traversal: TraversalChoice = TraversalChoice::Auto;
    }
    Tests {
        /// Leave out shader code that the scene does not need
        skip_unused: bool = true;
        /// Run-time checks in shaders
        shader_checks: ShaderChecks = ShaderChecks::Fast;
        /// Disturb the run, e.g. loss:dev1@3, slow:dev1@5..9 or scene-cut@7
        ///
        /// Write KIND:devI@FRAME for a fault of device I. KIND is loss, hang, oom (out of memory) or slow, which runs
        /// each dispatch twice; slow:devI@FROM..TO lasts until before frame TO. scene-cut@FRAME makes the camera of
        /// `play` jump. Give several disturbances in a list.
        disturb: Vec<Disturbance> = Vec::new(), of &["render", "play", "view", "scale"];
    }
}

/// Commands that open devices for frames of a shot.
const RUNS: &[&str] = &["render", "play", "view", "scale", "bench", "study"];
/// Commands that take any number of views.
const ROWS: &[&str] = &["render", "scale", "graph", "study"];
/// Commands that divide frames among devices.
const BALANCED: &[&str] = &["render", "play", "view", "scale", "bench", "study", "graph"];
/// Commands whose frames all have the quality of the settings.
const FIXED: &[&str] = &["render", "scale", "graph", "study"];
/// Commands whose frames have one denoiser and one foveation. `bench` takes lists.
const SINGLE: &[&str] = &["render", "scale", "graph", "play", "view", "study"];

impl Settings {
    /// Returns the policies without duplicates, or the default one: `static` with ratios, else `measured`.
    pub fn balances(&self) -> Vec<Balance> {
        match &self.balance[..] {
            [] if self.ratios.is_empty() => vec![Balance::Measured],
            [] => vec![Balance::Static],
            asked => {
                let is_new = |(place, policy): &(usize, &Balance)| !asked[..*place].contains(policy);
                asked.iter().enumerate().filter(is_new).map(|(_, policy)| *policy).collect()
            }
        }
    }

    /// Returns the policy of commands that use one.
    pub fn policy(&self) -> Balance {
        self.balances()[0]
    }

    /// Returns the filtering across stripes. With [`HaloMode::Cost`], the plan is the first one, and costs may change
    /// it.
    pub fn seam(&self) -> Seam {
        match (self.seam, self.halo) {
            (SeamMode::None, _) => Seam::None,
            (SeamMode::Filter, _) => Seam::Filter,
            (SeamMode::Halo, HaloMode::Cost | HaloMode::Recompute) => Seam::Halo(HaloPlan::RECOMPUTE),
            (SeamMode::Halo, HaloMode::Exchange) => Seam::Halo(HaloPlan::EXCHANGE),
        }
    }

    /// Returns the gaze of each eye that replaces the shot's.
    pub fn gaze(&self) -> Option<[Gaze; 2]> {
        self.gaze.map(|EyePoints(eyes)| eyes.map(|[x, y]| Gaze { path: vec![[0.0, x, y]] }))
    }

    /// Returns the time limit of a reference, if there is one.
    pub fn time_limit(&self) -> Option<Duration> {
        self.time_limit.and_then(|s| Duration::try_from_secs_f64(s).ok())
    }
}
