//! Maps a polar image to the screen.

use glam::Vec4;

use super::resources::{DISPLAY, LINEAR, POLAR, RECTIFIED, RECTIFIED_DISPLAY};
use super::{Declared, Display, FrameSpec, tonemap};
use crate::graph::{Grid, Kernel, Partition, Pass, Reach, Resource, Stage, Use};
use crate::scene::rig::Eye;
use crate::wgsl::arguments;

const PARTITION: Partition = Partition("to_screen");

/// Results of the separable blur: along the rings (`AROUND`), and then also across them (`BLURRED`).
const AROUND: Resource = Resource::image::<Vec4>("polar_around");
const BLURRED: Resource = Resource::image::<Vec4>("polar_blurred");

arguments! {
    struct BlurArguments {
        /// 0 along the rows, 1 across them.
        pub axis: u32,
        /// Maximum radius, pixels.
        pub reach: u32,
    }
}

/// Returns the maximum blur radius in pixels for a polar image with `rows` rows.
fn blur_reach(rows: u32) -> u32 {
    rows.div_ceil(24)
}

/// Adds the passes that blur a view's finished polar image and map it to the screen.
pub fn show(spec: &FrameSpec, view: Eye, frame: &mut Declared) {
    let Some(space) = spec.chain.polar else { return };
    let kernel = space.method().blur();
    let reach = blur_reach(spec.extent.height);
    let blur = |axis, read: Use, target| {
        let pass = Pass::new(Stage("polar_blur"), view, tonemap::PARTITION, Kernel::new(kernel.unwrap_or_default()));
        pass.index(axis)
            .uses([read.named("source"), Use::write(target).named("blurred")])
            .with([BlurArguments { axis, reach }])
    };
    for pass in [blur(0, Use::read(POLAR), AROUND), blur(1, Use::read(AROUND).halo(spec.halo(reach)), BLURRED)] {
        frame.add_if(kernel.is_some(), "the polar image is not blurred", pass);
    }
    let grid = Grid::Fixed(spec.chain.screen());
    let [linear, display] = match spec.chain.display {
        Display::Direct => [LINEAR, DISPLAY],
        Display::Resampled { .. } => [RECTIFIED, RECTIFIED_DISPLAY],
    };
    frame.add(Pass::new(Stage("to_screen"), view, PARTITION, Kernel::new("to_screen")).on(grid).uses([
        Use::read(if kernel.is_some() { BLURRED } else { POLAR }).reaching(Reach::All).named("polar"),
        Use::write(linear.on(grid)).named("linear"),
        Use::write(display.on(grid)).named("display"),
    ]));
}
