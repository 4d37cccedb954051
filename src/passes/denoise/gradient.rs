//! Temporal gradients in dynamic scenes: the relative change of the left eye's light since the previous frame, from
//! paths traced again with the same random numbers (Schied, Peters & Dachsbacher, "Gradient Estimation for Real-Time
//! Adaptive Temporal Filtering", 2018).

use glam::Vec2;

use super::PARTITION;
use crate::graph::{Grid, Kernel, Pass, Resource, Stage, Use};
use crate::image::Extent;
use crate::passes::gbuffer::{GUIDE, HIT};
use crate::passes::resources::{RADIANCE, last_surface};
use crate::passes::{FrameSpec, PREVIOUS};
use crate::scene::rig::Eye;
use crate::wgsl::{Constant, arguments, constants};

/// Edge length of a tile in pixels. One pixel per tile is traced again.
const TILE: u32 = 3;
const TILES: Grid = Grid::FrameOver(TILE);

/// Radius in tiles of the filter that smooths gradients.
const REACH: u32 = 2;

/// Constants of shaders that bind [`read_change`].
pub const CONSTANTS: &[Constant] = constants![TILE];

arguments! {
    struct GradientArguments {
        /// Size of the frame, pixels.
        pub width: u32,
        pub height: u32,
        /// 1 to trace this frame's probes, 0 to trace those of the previous frame again.
        pub of_probes: u32,
    }
}

const TRACE: Kernel = Kernel::tracing_rays("gradient").with(constants![TILE]);
const SMOOTH: Kernel = Kernel::new("gradient_smooth").with(constants![REACH]);

/// Two values for the retraced pixel of each tile: its luminance minus that in the previous frame, and the larger of
/// the two luminances.
const GRADIENT: Resource = Resource::image::<Vec2>("gradient").on(TILES);

/// Luminance of the path that a frame of several samples per pixel traces for the next frame to trace again; negative
/// without such a path.
const PROBE: Resource = Resource::image::<f32>("probe").on(TILES);

/// Returns true if gradients are computed: only in dynamic scenes, and not in polar images, whose tiles are not square.
fn is_found(spec: &FrameSpec) -> bool {
    spec.moving.is_some() && spec.chain.polar.is_none()
}

/// Returns the image `light_change`, which holds, for each tile, the fraction of its history to drop. If gradients are
/// not computed, the image is a dummy of one pixel.
fn change(spec: &FrameSpec) -> Resource {
    let nothing = Grid::Fixed(Extent::new(1, 1));
    Resource::image::<f32>("light_change").on(if is_found(spec) { TILES } else { nothing })
}

/// Returns the binding of the image `light_change` of a view's source, which holds the fraction of each tile's history to
/// drop.
pub fn read_change(spec: &FrameSpec, view: Eye) -> Use {
    Use::read(change(spec)).of(view.source()).if_written().named("light_change")
}

/// Returns the passes that compute gradients. They run before a source's accumulation; there are none for other
/// views.
pub fn passes(spec: &FrameSpec, view: Eye) -> Vec<Pass> {
    // Imported frames have no paths to trace again. No pass writes their `light_change`, whose zeros mean no change.
    if !is_found(spec) || !view.is_source() || spec.imported {
        return Vec::new();
    }
    let last = |resource| Use::read(resource).before(spec.history_halo());
    let Extent { width, height } = spec.extent;
    let trace = Pass::new(Stage("gradient"), view, PARTITION, TRACE)
        .on(TILES)
        .uses([
            Use::read(last_surface(spec)),
            Use::read(HIT),
            Use::read(GUIDE),
            last(HIT),
            last(GUIDE),
            last(RADIANCE),
            last(PROBE),
            Use::write(PROBE),
            Use::write(GRADIENT),
            Use::read(PREVIOUS),
        ])
        .with([0, 1].map(|of_probes| GradientArguments { width, height, of_probes }));
    let smooth = Pass::new(Stage("gradient_smooth"), view, PARTITION, SMOOTH)
        .on(TILES)
        .uses([Use::read(GRADIENT).halo(spec.halo(REACH)), Use::write(change(spec))]);
    vec![trace, smooth]
}
