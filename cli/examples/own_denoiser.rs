//! The commands of `diptych` with a custom denoiser: the mean of neighbours whose surface has the same normal.
//!
//! `cargo run --release --example own_denoiser -- bench --denoiser none,atrous,mean --quick --out out/own`

use std::process::ExitCode;

use diptych::graph::{Chain, Kernel, Pass, Stage, Use};
use diptych::passes::denoise::{Denoise, Light, PARTITION};
use diptych::passes::{FrameSpec, gbuffer::GUIDE};
use diptych::scene::rig::Eye;
use diptych_cli::{Program, prepare_environment};
use glam::Vec4;

/// Rows and columns that the filter reads on each side of a pixel.
const REACH: u32 = 3;

/// Source of the filter's kernel. The fourth channel of `guide_image` is the packed normal. The kernel may only read
/// rows from `valid_begin` up to, but not including, `valid_end`.
const SHADER: &str = "
//!include frame grid bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let reach = pass_.args[0];
    let normal = guide_image[pixel_index(pixel)].w;
    var sum = vec4<f32>(0.0);
    for (var y = max(pixel.y, pass_.valid_begin + reach) - reach; y <= min(pixel.y + reach, pass_.valid_end - 1u); y += 1u) {
        for (var x = max(pixel.x, reach) - reach; x <= min(pixel.x + reach, pass_.width - 1u); x += 1u) {
            let tap = pixel_index(vec2<u32>(x, y));
            sum += select(vec4<f32>(0.0), vec4<f32>(source[tap].rgb, 1.0), guide_image[tap].w == normal);
        }
    }
    filtered[pixel_index(pixel)] = vec4<f32>(sum.rgb / sum.w, 1.0);
}";

struct Mean;

impl Denoise for Mean {
    fn name(&self) -> &'static str {
        "mean"
    }

    fn help(&self) -> Option<&'static str> {
        Some("Mean of neighbours with the same normal")
    }

    /// Returns the passes of the filter. The graph transfers the rows of their halos between stripes.
    fn filter(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let iteration = |index| {
            let (source, target) = light.advance();
            let halo = spec.halo(REACH);
            let pass = Pass::new(Stage("mean"), view, PARTITION, Kernel::from_text("mean", SHADER)).index(index);
            // Access the images of light as floats: the filter needs no variance.
            let [source, target] = [Use::read(source).halo(halo).named("source"), Use::write(target).named("filtered")];
            let uses = [Use::read(GUIDE).halo(halo), source.viewed_as::<Vec4>(), target.viewed_as::<Vec4>()];
            pass.uses(uses).args([REACH, 0, 0]).chain(Chain::Planned)
        };
        (0..spec.iterations).map(iteration).collect()
    }
}

pub fn main() -> ExitCode {
    // SAFETY: the program has no other thread yet.
    unsafe { prepare_environment() };
    Program::new().denoiser(&Mean).run()
}
