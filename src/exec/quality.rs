//! Validation of the quality of a frame.

use crate::quality::{Denoiser, Quality};
use crate::stages::RunConfig;

/// Checks that a renderer of this configuration has the pipelines and buffers for a frame of this quality.
pub(super) fn check(quality: &Quality, config: &RunConfig) -> Result<(), String> {
    let most = config.quality();
    let (iterations, most_iterations) = (quality.most_iterations(), most.most_iterations());
    quality.spp.check_within(most.spp, config.envelope.centres_one())?;
    if !(quality.scale > 0.0 && quality.scale <= 1.0) || (quality.scale < 1.0 && !config.leaves_pixels()) {
        return Err(format!("it has no pipelines for a render scale of {}", quality.scale));
    }
    if quality.fovea.is_some() && most.fovea.is_none() {
        return Err("it has no pipelines for foveal layers".to_owned());
    }
    if quality.polar != most.polar {
        return Err("the polar mapping differs from the renderer's".to_owned());
    }
    if quality.denoiser() != most.denoiser() {
        let [asked, had] = [quality.denoiser(), most.denoiser()].map(Denoiser::name_of);
        return Err(format!("the denoiser is {asked}, but the renderer was built for {had}"));
    }
    let least = u32::from(most.filter.is_some());
    if !(least..=most_iterations).contains(&iterations) {
        return Err(format!("{iterations} denoiser iterations are outside the range {least} to {most_iterations}"));
    }
    Ok(())
}
