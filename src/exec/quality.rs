//! Quality settings that may change from frame to frame: their defaults, and validation.

use super::RenderSettings;
use crate::quality::{Denoiser, Quality};

/// Returns the default quality of frames.
pub(super) fn of(settings: &RenderSettings) -> Quality {
    let stages = &settings.stages;
    let (spp, bounces, denoiser, scale) = (stages.spp, settings.bounces, denoiser(settings), settings.scale);
    let layers = stages.foveation.as_ref().map_or([stages.iterations; 3], |f| f.iterations);
    let iterations = layers.map(|n| n.min(stages.iterations));
    let fovea = stages.foveation.as_ref().map(|f| f.radii);
    let polar = stages.polar.as_ref().map(|polar| polar.space);
    Quality { spp, bounces, denoiser, iterations, fovea, polar, scale }
}

fn denoiser(settings: &RenderSettings) -> Option<Denoiser> {
    settings.stages.filter.filter(|_| settings.stages.iterations > 0)
}

pub(super) fn check(quality: &Quality, settings: &RenderSettings) -> Result<(), String> {
    let stages = &settings.stages;
    let (iterations, denoiser) = (quality.most_iterations(), denoiser(settings));
    if quality.spp == 0 || quality.spp > stages.spp {
        return Err(format!("{} samples per pixel are outside the range 1 to {}", quality.spp, stages.spp));
    }
    if (quality.spp > 1) != stages.jitter(quality.spp) {
        return Err("it has no pipelines for one sample per pixel".to_owned());
    }
    if !(quality.scale > 0.0 && quality.scale <= 1.0) || (quality.scale < 1.0 && !stages.leaves_pixels()) {
        return Err(format!("it has no pipelines for a render scale of {}", quality.scale));
    }
    if quality.fovea.is_some() && stages.foveation.is_none() {
        return Err("it has no pipelines for foveal layers".to_owned());
    }
    if quality.polar != stages.polar.as_ref().map(|polar| polar.space) {
        return Err("the polar mapping differs from the renderer's".to_owned());
    }
    if quality.denoiser != denoiser {
        let [asked, had] = [quality.denoiser, denoiser].map(Denoiser::name_of);
        return Err(format!("the denoiser is {asked}, but the renderer was built for {had}"));
    }
    let least = u32::from(denoiser.is_some());
    if !(least..=stages.iterations).contains(&iterations) {
        return Err(format!("{iterations} denoiser iterations are outside the range {least} to {}", stages.iterations));
    }
    Ok(())
}
