//! `diptych view`: a window to look around in, inside a frame budget.
//!
//! The window and its input are on the main thread, as operating systems require. The control loop and all devices that
//! render are on another thread, so that neither waits for the other.

mod args;
mod camera;
#[cfg(feature = "xr")]
mod headset;
mod layout;
mod status;
mod overlay;
mod painter;
mod present;
mod renderer;
mod shared;
mod window;

use std::sync::Arc;

use anyhow::{Context, anyhow};
use winit::event_loop::EventLoop;

use super::failure::Failure;
use super::play::Prepared;
use super::progress::Progress;
use super::setup::{self, Tracing};
use super::{interrupt, metering};
pub use args::Args;
use renderer::Start;
use shared::Shared;
use status::ViewStatus;
use window::{App, Wake};

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.options.run.settings.controller.len() > 1 {
        let what = "controller: give one name; `diptych play` compares several";
        return Err(Failure::Input(anyhow!(what)));
    }
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
    let mut loaded = setup::load(options)?;
    setup::tell_remarks(&loaded.scene);
    // Open devices before the renderer's thread starts: Mesa takes thread counts from the environment, which other
    // threads must not read meanwhile.
    let gpus = setup::open_devices(options, usize::from(args.options.virtual_devices))?;
    let gpus = metering::meter(options, &mut loaded, gpus, &progress)?;
    let look = ViewStatus::new(&prepared, &loaded, &gpus.infos());
    let shared = Arc::new(Shared::default());
    let start = Start { prepared, loaded, gpus, tracing, progress };
    let mut app = App::new(look, start, shared, events.create_proxy());
    events.run_app(&mut app).context("the windowing system failed")?;
    let _writing = interrupt::writing();
    let screenshot = app.end(args.screenshot.is_some())?;
    if let (Some(path), Some(picture)) = (&args.screenshot, screenshot) {
        diptych::image::display::write_png(path, &picture)?;
    }
    interrupt::check()
}

#[cfg(feature = "xr")]
use headset::run as into_headset;

#[cfg(not(feature = "xr"))]
fn into_headset(_: &Args) -> Result<(), Failure> {
    let how = "--xr: this build of diptych supports no headsets: build it with `cargo build --release --features xr`";
    Err(Failure::Input(anyhow!(how)))
}
