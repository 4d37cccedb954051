//! Appends a custom pass to the renderer: an outline where the distance to the eye jumps between neighbouring pixels.
//! The example checks the pass against its shader, runs it on two virtual devices, and writes its output as a PNG.
//!
//! `cargo run --release --example own_pass -- [FILE.png]`

use std::path::PathBuf;

use diptych::exec::TimedTask;
use diptych::graph::{Kernel, Pass, Resource, Stage, Use};
use diptych::image::display::write_png;
use diptych::image::stereo::side_by_side;
use diptych::image::{Extent, Image};
use diptych::passes::gbuffer::EMISSION;
use diptych::passes::{Declarations, declare, tonemap};
use diptych::scene::rig::Eye;
use diptych::schedule::Even;
use diptych::stages::verify;
use diptych::{LoadedScene, Renderer};

const EXTENT: Extent = Extent::new(160, 90);

const OUTLINE_STAGE: Stage = Stage("outline");

/// Grey value of the outline, 0 or 255, in 4 bytes per pixel. As an output, the image is gathered on the primary device
/// at the end of the frame.
const OUTLINE: Resource = Resource::image::<u32>("outline").output();

/// The fourth channel of `emission_image` is the distance along the ray, 0 for the sky.
const SHADER: &str = "
//!include frame grid bindings

const JUMP: f32 = 1.1;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let last = vec2<u32>(pass_.width, pass_.height) - 1u;
    let here = emission_image[pixel_index(pixel)].w;
    let right = emission_image[pixel_index(vec2<u32>(min(pixel.x + 1u, last.x), pixel.y))].w;
    let below = emission_image[pixel_index(vec2<u32>(pixel.x, min(pixel.y + 1u, last.y)))].w;
    let least = min(here, min(right, below));
    let most = max(here, max(right, below));
    outline[pixel_index(pixel)] = select(0u, 255u, most > JUMP * least);
}";

/// Returns the outline pass of one eye. It reads one row beyond each edge of a stripe. Its rows are divided among the
/// devices like those of tonemap.
fn outline(view: Eye) -> Pass {
    let kernel = Kernel::from_text("outline", SHADER);
    let uses = [Use::read(EMISSION).halo(1), Use::write(OUTLINE)];
    Pass::new(OUTLINE_STAGE, view, tonemap::PARTITION, kernel).uses(uses)
}

fn main() -> anyhow::Result<()> {
    let file = std::env::args().nth(1).map_or_else(|| std::env::temp_dir().join("diptych_outline.png"), PathBuf::from);
    verify(&outline(Eye::LEFT))?;
    let scene = LoadedScene::load("builtin:cornell")?;
    let passes = Declarations::new(|spec| {
        let mut passes = declare(spec).passes;
        passes.extend(Eye::BOTH.map(outline));
        passes
    });
    let builder = Renderer::builder(&scene).size(EXTENT.width, EXTENT.height).devices(2);
    let builder = builder.policy(|rows, devices| Box::new(Even::new(rows, devices)));
    let mut renderer = builder.configure(|config| config.buffers.declarations = passes).build()?;
    let report = renderer.render(&renderer.frame(&scene.shot.rig, 0.0, 0))?;
    for task in report.tasks.iter().filter(|task| task.kind == TimedTask::Gpu(OUTLINE_STAGE)) {
        let (device, rows, ms) = (task.device, &task.rows, task.end_ms - task.begin_ms);
        println!("outline of the {} eye, rows {rows:?} on device {device}: {ms:.2} ms", task.view);
    }
    let found = renderer.read_output(OUTLINE)?;
    let [left, right] = [found.left(), found.right()].map(|bytes| {
        let pixels = bytes.chunks_exact(4).map(|pixel| [pixel[0]; 3]).collect();
        Image { extent: EXTENT, pixels }
    });
    println!("{} pixels of the left eye are on an outline", left.pixels.iter().filter(|p| p[0] > 0).count());
    write_png(&file, &side_by_side(&left, &right)?)?;
    println!("{}", file.display());
    Ok(())
}
