//! Smooths across the seams of stripes that were filtered separately, with a bilateral filter.

use super::atrous::inverse_sigma2_bits;
use super::{CUT, Light};
use crate::graph::{Kernel, Pass, Stage, Use};
use crate::passes::gbuffer::GUIDE;
use crate::scene::rig::Eye;

/// The number of rows read beyond a stripe, `REACH` in the shader.
const REACH_ROWS: u32 = 4;

pub fn pass(view: Eye, light: &mut Light) -> Pass {
    let (source, target) = light.advance();
    let uses = [Use::read(GUIDE).halo(REACH_ROWS), Use::read(source).halo(REACH_ROWS), Use::write(target)];
    let pass = Pass::new(Stage("seam_filter"), view, CUT, Kernel::new("seam_filter"));
    pass.uses(uses).args([0, inverse_sigma2_bits(u32::MAX), 0])
}
