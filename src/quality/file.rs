//! The form of a quality in ladders, journals and `run.json`.

use serde::{Deserialize, Serialize};

use super::{Denoiser, Filter, PolarSpace, Quality};
use crate::passes::denoise;
use crate::samples;

/// The members of a [`Quality`]. Without a filter, the denoiser is `none` and has 0 iterations.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Members {
    spp: u32,
    #[serde(default, skip_serializing_if = "samples::is_zero")]
    extra: f64,
    bounces: u32,
    #[serde(serialize_with = "denoise::serialize", deserialize_with = "denoise::deserialize")]
    denoiser: Option<Denoiser>,
    iterations: FileIterations,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    fovea: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    polar: Option<PolarSpace>,
    scale: f64,
}

/// One number if all foveal layers have the same, else one per layer.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum FileIterations {
    Alike(u32),
    Layers([u32; 3]),
}

impl From<Quality> for Members {
    fn from(quality: Quality) -> Self {
        let Quality { spp, bounces, fovea, polar, scale, .. } = quality;
        let iterations = match quality.iterations() {
            [inner, middle, outer] if inner == middle && middle == outer => FileIterations::Alike(inner),
            layers => FileIterations::Layers(layers),
        };
        let (spp, extra, denoiser) = (spp.least, spp.fraction(), quality.denoiser());
        Self { spp, extra, bounces, denoiser, iterations, fovea, polar, scale }
    }
}

impl From<Members> for Quality {
    fn from(members: Members) -> Self {
        let Members { spp, extra, bounces, denoiser, iterations, fovea, polar, scale } = members;
        let iterations = match iterations {
            FileIterations::Alike(all) => [all; 3],
            FileIterations::Layers(layers) => layers,
        };
        let (spp, filter) = (samples::Members { spp, extra }.into(), Filter::in_effect(denoiser, iterations));
        Self { spp, bounces, filter, fovea, polar, scale }
    }
}
