//! Bilateral smoothing across the seams of stripes that were filtered separately.

use super::atrous::INVERSE_SIGMA2;
use super::{Light, PARTITION};
use crate::graph::{Kernel, Pass, Stage, Use};
use crate::passes::gbuffer::GUIDE;
use crate::scene::rig::Eye;
use crate::wgsl::{arguments, constants};

/// Filter radius, pixels, which is also the number of rows read beyond a stripe.
const SEAM_REACH: u32 = 4;

const KERNEL: Kernel = Kernel::new("seam_filter").with(constants![SEAM_REACH]);

arguments! {
    struct SeamArguments {
        /// 1 / σ² of the edge-stopping weight for differences in radiance.
        pub inverse_sigma2: f32,
    }
}

pub fn pass(view: Eye, light: &mut Light) -> Pass {
    let (source, target) = light.advance();
    let uses = [
        Use::read(GUIDE).halo(SEAM_REACH),
        Use::read(source).halo(SEAM_REACH).named("source"),
        Use::write(target).named("filtered"),
    ];
    let pass = Pass::new(Stage("seam_filter"), view, PARTITION, KERNEL);
    pass.uses(uses).with([SeamArguments { inverse_sigma2: INVERSE_SIGMA2 }])
}
