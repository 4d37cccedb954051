//! `diptych view`: a window to look around in, inside a frame budget.
//!
//! The window and its input are on the main thread, as operating systems require. The control loop and all devices that
//! render are on another thread, so that neither waits for the other.

mod camera;
#[cfg(feature = "xr")]
mod headset;
mod layout;
mod look;
mod overlay;
mod present;
mod renderer;
mod shared;
mod window;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use winit::event_loop::EventLoop;

use super::failure::Failure;
use super::interrupt;
use super::options::RunOptions;
use super::play::{LoopOptions, Prepared};
use super::progress::Progress;
use super::setup::{self, Tracing};
use look::Look;
use renderer::Start;
use shared::Shared;
use window::{App, Wake};

/// Help of `--out`, which has no effect without a headset: the window writes only files that options name.
const OUT: &str = "With --xr: folder for run.json and frames.csv; created if missing";

#[derive(clap::Args, Clone, Debug)]
#[command(mut_arg("out", |out| out.required(false).default_value(".").hide(!cfg!(feature = "xr")).help(OUT)))]
pub struct Args {
    #[command(flatten)]
    options: LoopOptions,
    /// Close after this number of frames
    #[arg(long, help_heading = super::options::SCENE, value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Render into a headset through OpenXR [needs the feature `xr`]
    ///
    /// The runtime sets the time and pose of frames; --size and --budget-ms default to what it recommends.
    #[arg(long, help_heading = super::options::SCENE)]
    xr: bool,
    /// With --xr: overscan for late reprojection, degrees; 0 turns it off
    #[cfg(feature = "xr")]
    #[arg(long, requires = "xr", default_value_t = 2.0, value_name = "DEG", value_parser = late_border, help_heading = super::options::SCENE)]
    late_border: f64,
    /// With --xr: show the panel with frame times from the start
    #[cfg(feature = "xr")]
    #[arg(long, requires = "xr", help_heading = super::options::SCENE)]
    panel: bool,
    /// Write the last picture as a PNG
    #[arg(long, value_name = "FILE", help_heading = super::options::OUTPUT)]
    screenshot: Option<PathBuf>,
}

#[cfg(feature = "xr")]
fn late_border(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|degrees| (0.0..=30.0).contains(degrees));
    degrees.ok_or_else(|| format!("'{text}' is no number of degrees from 0 to 30"))
}

impl Args {
    pub fn run_options(&self) -> Option<&RunOptions> {
        Some(&self.options.run)
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.xr {
        return into_headset(args);
    }
    let prepared = Prepared::new(&args.options, args.frames)?;
    let options = &prepared.render;
    interrupt::watch()?;
    let events = EventLoop::<Wake>::with_user_event()
        .build()
        .map_err(|_| anyhow!("cannot open a window: there is no display here; `diptych play` needs none"))?;
    let tracing = Tracing::start(options)?;
    let progress = Progress::text(options.quiet, options.json);
    progress.phase("loading");
    let loaded = setup::load(options)?;
    for warning in &loaded.scene.warnings {
        progress.warn(warning);
    }
    // Open devices before the renderer's thread starts: Mesa takes thread counts from the environment, which other
    // threads must not read meanwhile.
    let gpus = setup::open_devices(options, usize::from(args.options.virtual_devices))?;
    let look = Look {
        scene: loaded.shot.name.clone(),
        eye: options.size,
        band_ms: [args.options.budget_ms.lo_ms(), args.options.budget_ms.hi_ms()],
        devices: gpus.infos().iter().map(|info| format!("dev{} {}", info.index, info.name)).collect(),
        is_foveated: options.foveated.is_on(),
    };
    let shared = Arc::new(Shared::default());
    let start = Start { prepared, loaded, gpus, tracing, progress };
    let mut app = App::new(look, start, shared, events.create_proxy());
    events.run_app(&mut app).context("the window's system failed")?;
    let screenshot = app.end(args.screenshot.is_some())?;
    if let (Some(path), Some(picture)) = (&args.screenshot, screenshot) {
        crate::image::display::write_png(path, &picture)?;
    }
    interrupt::check()
}

#[cfg(feature = "xr")]
use headset::run as into_headset;

#[cfg(not(feature = "xr"))]
fn into_headset(_: &Args) -> Result<(), Failure> {
    let how =
        "--xr: this diptych was built without headsets: `cargo build --release --features xr` builds it with them";
    Err(Failure::Input(anyhow!(how)))
}
