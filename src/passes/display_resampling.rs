//! Display resampling from the shared (rectified) projection to each eye's own.

use super::gbuffer::EMISSION;
use super::resources::{DISPLAY, LINEAR, RECTIFIED};
use super::{Display, FrameSpec};
use crate::graph::{Grid, Kernel, Partition, Pass, Reach, Stage, Use};
use crate::image::Extent;
use crate::scene::rig::Eye;
use crate::wgsl::arguments;

const PARTITION: Partition = Partition("to_eye");
/// Partition of the late reprojection passes of both eyes, which are the last passes of a frame.
pub const LATE_PARTITION: Partition = Partition("to_later_eye");

arguments! {
    /// Size of the shared projection, pixels.
    struct SizeArguments {
        pub width: u32,
        pub height: u32,
    }
}

const LATE: Kernel = Kernel::new("late_reprojection");

/// Returns the pass that resamples a view's finished image for display, if the image is not displayed as rendered.
pub fn pass(spec: &FrameSpec, view: Eye) -> Option<Pass> {
    let Display::Resampled { projection, is_late } = spec.chain.display else { return None };
    let grid = Grid::Fixed(spec.chain.displayed);
    let (stage, partition, kernel) =
        if is_late { ("to_later_eye", LATE_PARTITION, LATE) } else { ("to_eye", PARTITION, Kernel::new("to_eye")) };
    let Extent { width, height } = projection;
    let pass = Pass::new(Stage(stage), view, partition, kernel).on(grid).with([SizeArguments { width, height }]);
    let pass = pass.uses([
        Use::read(RECTIFIED.on(Grid::Fixed(projection))).reaching(Reach::All),
        Use::write(LINEAR.on(grid)),
        Use::write(DISPLAY.on(grid)),
    ]);
    // `EMISSION` also holds the depth of surfaces.
    Some(if is_late { pass.uses([Use::read(EMISSION).reaching(Reach::All)]) } else { pass })
}
