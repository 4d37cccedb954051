//! `atrous`: an edge-avoiding à-trous filter that uses only the current frame.

use super::{Denoise, Light, PARTITION};
use crate::graph::{Chain, Kernel, Pass, Stage, Use};
use crate::passes::FrameSpec;
use crate::passes::gbuffer::GUIDE;
use crate::scene::rig::Eye;
use crate::wgsl::arguments;

const STAGE: Stage = Stage("atrous");

/// σ of the edge-stopping weight for differences in compressed radiance, c / (1 + luminance), after the iterations that
/// ignore them: at one sample per pixel, a pixel's value is mostly noise, and comparing with it would preserve outliers.
const SIGMA: f32 = 1.0;

/// Returns the distance between the taps of iteration `index` of `count`: 2^(count-1) down to 1.
fn step(index: u32, count: u32) -> u32 {
    1 << (count - 1 - index)
}

/// 1 / σ² of iterations that compare radiance.
pub(super) const INVERSE_SIGMA2: f32 = 1.0 / (SIGMA * SIGMA);

arguments! {
    struct AtrousArguments {
        /// Distance between taps, pixels.
        pub step: u32,
        /// 1 / σ² of the edge-stopping weight for differences in radiance.
        pub inverse_sigma2: f32,
        /// Number of the layer's first iterations that ignore differences in radiance.
        pub blind: u32,
    }
}

pub struct Atrous;

impl Denoise for Atrous {
    fn name(&self) -> &'static str {
        "atrous"
    }

    fn help(&self) -> Option<&'static str> {
        Some("Spatial à-trous filter")
    }

    fn filters_lobes(&self) -> bool {
        true
    }

    fn leaves_out_narrow_lobes(&self) -> bool {
        true
    }

    fn filter(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        let iteration = |index| {
            let (source, target) = light.advance();
            let step = step(index, spec.iterations);
            let halo = spec.halo(2 * step);
            // If the filter fills in pixels that are not path traced, a foveal layer may take part only in the last
            // iterations. The shader then counts the blind iterations of each layer.
            let (inverse_sigma2, blind) = match spec.sparse {
                true => (INVERSE_SIGMA2, spec.blind_iterations),
                false if index < spec.blind_iterations => (0.0, 0),
                false => (INVERSE_SIGMA2, 0),
            };
            let uses = [
                Use::read(GUIDE).halo(halo),
                Use::read(source).halo(halo).named("source"),
                Use::write(target).named("filtered"),
            ];
            let pass = Pass::new(STAGE, view, PARTITION, Kernel::new("atrous")).index(index);
            pass.uses(uses).with([AtrousArguments { step, inverse_sigma2, blind }]).chain(Chain::Planned)
        };
        (0..spec.iterations).map(iteration).collect()
    }
}
