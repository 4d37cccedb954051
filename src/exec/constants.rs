//! What every shader of a frame is told.

use std::ops::Range;

use super::RenderSettings;
use crate::image::Extent;
use crate::quality::Quality;
use crate::scene::rig::{Eye, Rig};
use crate::stages::{SceneTables, layout};

/// Constants of the frame that the rig sees at `time_s`, with these samples of its pixels' sequences. They name no
/// history.
pub fn constants(
    settings: &RenderSettings,
    quality: &Quality,
    tables: &SceneTables,
    rig: &Rig,
    time_s: f64,
    index: u32,
    samples: Range<u32>,
) -> layout::Frame {
    let stages = &settings.stages;
    let Extent { width, height } = stages.extent;
    let aspect = f64::from(width) / f64::from(height);
    let rig = rig.relative_to(tables.origin());
    let spp = samples.end - samples.start;
    let mut frame = layout::Frame {
        views: Eye::ALL.map(|eye| layout::View::new(&rig.view(time_s, eye), aspect)),
        width,
        height,
        index,
        seed: settings.seed,
        spp,
        sample_base: samples.start,
        reflections: quality.bounces.max(1),
        layer_iterations: quality.iterations,
        indirect_clamp: settings.indirect_clamp,
        exposure: settings.exposure_ev.exp2(),
        curve_shift: layout::NO_CURVE,
        history_rows: layout::NO_HISTORY,
        centre: stages.centre(index, spp),
        sampled_share: (quality.scale * quality.scale) as f32,
        // Pixels that wait for a later frame have their turn in time.
        mask_turn: if stages.keeps_history() { index.wrapping_mul(GOLDEN_RATIO) } else { 0 },
        ..Default::default()
    };
    tables.describe(&mut frame);
    if let Some(foveation) = &stages.foveation {
        foveation.describe(&mut frame, time_s, quality.fovea);
    }
    frame
}

/// The fractional part of the golden ratio, times 2^32.
const GOLDEN_RATIO: u32 = 0x9e37_79b9;

/// [`layout::Frame::curve_shift`] for pixels that all take `spp` samples.
pub fn curve_shift(extent: Extent, spp: u32) -> u32 {
    let bits_for = |count: u32| u32::BITS - count.saturating_sub(1).leading_zeros();
    let shift = bits_for(spp);
    let numbers = 2 * bits_for(extent.width.max(extent.height)) + shift;
    if numbers > u32::BITS { layout::NO_CURVE } else { shift }
}
