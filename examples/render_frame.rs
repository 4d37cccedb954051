//! Renders one stereo frame and writes it as a PNG.
//!
//! `cargo run --release --example render_frame -- [builtin:NAME or a file] [FILE.png]`

use std::path::PathBuf;

use diptych::image::display::{tonemap, write_png};
use diptych::image::stereo::side_by_side;
use diptych::{LoadedScene, Renderer};

/// Number of warm-up frames before the frame that is saved. Each extends the temporal history that SVGF uses.
const WARM_UP: u32 = 7;

fn main() -> anyhow::Result<()> {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_else(|| "builtin:cornell".to_owned());
    let file = args.next().map_or_else(|| std::env::temp_dir().join("diptych_frame.png"), PathBuf::from);

    let scene = LoadedScene::load(&name)?;
    let mut renderer = Renderer::builder(&scene).size(160, 90).build()?;
    for frame in 0..WARM_UP {
        renderer.render(&renderer.frame(&scene.shot.rig, 0.0, frame))?;
    }
    let report = renderer.render(&renderer.frame(&scene.shot.rig, 0.0, WARM_UP))?;
    let rays: u64 = report.tallies.iter().map(|eye| eye.rays).sum();
    println!("{name} on {}: {:.1} ms, {rays} rays", renderer.devices()[0].name, report.makespan_ms);

    let (linear, shot) = (renderer.read_linear()?, &scene.shot);
    let [left, right] = [linear.left(), linear.right()].map(|eye| tonemap(eye, shot.exposure_ev, shot.tone));
    write_png(&file, &side_by_side(&left, &right)?)?;
    println!("{}", file.display());
    Ok(())
}
