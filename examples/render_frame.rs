//! Renders one stereo frame of a built-in scene on one device and writes it as a PNG.
//!
//! `cargo run --release --example render_frame -- [builtin:NAME or a file] [FILE.png]`

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use diptych::accel::Accel;
use diptych::device::{self, Selection};
use diptych::exec::{RenderSettings, Renderer};
use diptych::image::Extent;
use diptych::image::display::{tonemap, write_png};
use diptych::image::stereo::side_by_side;
use diptych::scene::load::load_shot;
use diptych::schedule::Even;
use diptych::stages::SceneTables;

/// Frames before the one that is kept: with SVGF, each adds to the history of the next.
const WARM_UP: u32 = 7;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_else(|| "builtin:cornell".to_owned());
    let file = args.next().map_or_else(|| std::env::temp_dir().join("diptych_frame.png"), PathBuf::from);

    // A shot names the scene and says where it is seen from.
    let (shot, scene) = load_shot(&name)?;
    let tables = Arc::new(SceneTables::new(&scene, Accel::build(&scene)?)?);
    let extent = Extent::new(160, 90);
    let settings = RenderSettings { exposure_ev: shot.exposure_ev, ..RenderSettings::new(extent, &scene, &tables) };

    let mut devices = device::open(&Selection::default())?;
    devices.truncate(1);
    let policy = Box::new(Even::new(extent.height, devices.len()));
    let mut renderer = Renderer::new(devices, tables, settings, policy, Instant::now())?;
    for frame in 0..WARM_UP {
        renderer.render(&shot.rig, 0.0, frame)?;
    }
    let report = renderer.render(&shot.rig, 0.0, WARM_UP)?;
    let rays: u64 = report.tallies.iter().map(|eye| eye.rays).sum();
    println!("{name} at {extent} on {}: {:.1} ms, {rays} rays", renderer.devices()[0].name, report.makespan_ms);

    let linear = renderer.read_linear()?;
    let [left, right] = [&linear.left, &linear.right].map(|eye| tonemap(eye, shot.exposure_ev));
    write_png(&file, &side_by_side(&left, &right)?)?;
    println!("{}", file.display());
    Ok(())
}
