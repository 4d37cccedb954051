//! The range of qualities in a run, which determines the pipelines and buffers to create.

use serde::{Deserialize, Serialize};

use super::{Denoiser, PolarSpace, Quality};
use crate::passes::denoise;

/// The bounds of the qualities that the frames of a run may have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Envelope {
    /// Maximum samples, extra samples, bounces and iterations, and minimum render scale. All frames have the denoiser and the polar
    /// projection that are set here.
    #[serde(with = "AllFields")]
    pub most: Quality,
    /// True if pixels with one sample (at their centre) and with several (jittered) mix in one run.
    pub mixes_spp: bool,
}

/// Serialization of a [`Quality`] in messages between ranks. Their binary format needs all fields, whereas files omit
/// optional ones.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Quality")]
struct AllFields {
    spp: u32,
    extra: f64,
    bounces: u32,
    #[serde(serialize_with = "denoise::serialize", deserialize_with = "denoise::deserialize")]
    denoiser: Option<Denoiser>,
    iterations: [u32; 3],
    fovea: Option<[f64; 2]>,
    polar: Option<PolarSpace>,
    scale: f64,
}

impl Envelope {
    /// Returns the bounds of these qualities, which share a denoiser. An empty slice gives those of
    /// [`Quality::default`].
    pub fn of(qualities: &[Quality]) -> Self {
        let Some(first) = qualities.first() else { return Self::from(Quality::default()) };
        let most = |number: fn(&Quality) -> u32| qualities.iter().map(number).fold(0, u32::max);
        let most = Quality {
            spp: most(|q| q.spp),
            extra: qualities.iter().map(|q| q.extra).fold(0.0, f64::max),
            bounces: most(|q| q.bounces),
            denoiser: qualities.iter().fold(first.denoiser, |denoiser: Option<Denoiser>, q| denoiser.or(q.denoiser)),
            iterations: [most(Quality::most_iterations); 3],
            fovea: qualities.iter().find_map(|q| q.fovea),
            polar: qualities.iter().find_map(|q| q.polar),
            scale: qualities.iter().map(|q| q.scale).fold(1.0, f64::min),
        };
        let mixes_spp = qualities.iter().any(|q| q.spp == 1 && (most.spp > 1 || most.extra > 0.0));
        Self { most, mixes_spp }
    }
}

impl From<Quality> for Envelope {
    fn from(most: Quality) -> Self {
        Self { most, mixes_spp: most.spp == 1 && most.extra > 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_envelope_holds_its_qualities() {
        let basic = Quality::default();
        let all = [Quality { spp: 4, iterations: [2, 3, 4], ..basic }, Quality { scale: 0.5, bounces: 2, ..basic }];
        let Envelope { most, mixes_spp } = Envelope::of(&all);
        assert_eq!((most.spp, most.bounces, most.iterations, most.scale, mixes_spp), (4, 6, [5; 3], 0.5, true));
        assert!(!Envelope::of(&all[..1]).mixes_spp);
        assert_eq!(Envelope::of(&[]), Envelope::from(basic));
    }
}
