//! The auxiliary image of history lengths.

use super::FrameSpec;
use super::gbuffer::{GUIDE, HIT};
use super::reproject::{REASONS, ReachArguments, of_source, reach};
use crate::graph::{Image, Kernel, Pass, Resource, Use};

/// Kernel that reads the counts of its own view, and kernel that reads those of the view's source wherever the view
/// takes over filtered light.
const OWN: Kernel = Kernel::new("history_length");
const TAKEN_OVER: Kernel = Kernel::new("reproject_history_length").with(REASONS);

/// Images of a denoiser that tell how many frames of history the light of a pixel has.
#[derive(Clone, Copy)]
pub struct Counted {
    /// The image that [`Denoise::frame_counts`](super::denoise::Denoise::frame_counts) returns.
    pub counts: Resource,
    /// Filtered light, which marks the pixels that a view takes over from its source.
    pub light: Image,
}

/// Makes `pass` write history lengths to `target`.
pub fn bind(spec: &FrameSpec, pass: Pass, Counted { counts, light }: Counted, target: Resource) -> Pass {
    let view = pass.view;
    let [own, target] = [Use::read(counts).named("counts"), Use::write(target).named("aov")];
    if spec.source(view).is_none() || !spec.takes_over_filtered_light() {
        return Pass { kernel: OWN, ..pass }.uses([own, target]);
    }
    Pass { kernel: TAKEN_OVER, ..pass }
        .uses([
            of_source(spec, view, HIT),
            of_source(spec, view, GUIDE),
            of_source(spec, view, counts).named("left_counts"),
            Use::read(HIT),
            Use::read(GUIDE),
            Use::read(light).named("filtered"),
            own,
            target,
        ])
        .with([ReachArguments { reach: reach(spec) }])
}
