//! The range of qualities in a run, which determines the pipelines and buffers to create.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::{Denoiser, Filter, Quality, SettingError};
use crate::samples::Samples;

/// The bounds of the qualities that the frames of a run may have.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Envelope {
    /// Maximum samples, bounces and iterations, and minimum render scale. All frames have the denoiser and the polar
    /// projection that are set here.
    pub most: Quality,
    /// True if pixels with one sample (at their centre) and with several (jittered) mix in one run.
    pub mixes_spp: bool,
    /// True if frames with and without the denoiser mix in one run.
    pub mixes_filter: bool,
}

impl Envelope {
    /// Returns the bounds of these qualities, which share a denoiser. An empty slice gives those of
    /// [`Quality::default`].
    pub fn of(qualities: &[Quality]) -> Self {
        let Some(first) = qualities.first() else { return Self::from(Quality::default()) };
        let most = |number: fn(&Quality) -> u32| qualities.iter().map(number).fold(0, u32::max);
        let iterations = [most(Quality::most_iterations); 3];
        let most = Quality {
            spp: qualities.iter().map(|q| q.spp).fold(first.spp, Samples::max),
            bounces: most(|q| q.bounces),
            filter: qualities.iter().find_map(|q| q.filter).map(|filter| Filter { iterations, ..filter }),
            fovea: qualities.iter().find_map(|q| q.fovea),
            polar: qualities.iter().find_map(|q| q.polar),
            scale: qualities.iter().map(|q| q.scale).fold(1.0, f64::min),
        };
        let mixes_spp = qualities.iter().any(|q| q.spp.least == 1 && most.spp != Samples::ONE);
        let mixes_filter = most.filter.is_some() && qualities.iter().any(|q| q.filter.is_none());
        Self { most, mixes_spp, mixes_filter }
    }
}

impl From<Quality> for Envelope {
    fn from(most: Quality) -> Self {
        Self { most, mixes_spp: most.spp.is_between_one_and_two(), mixes_filter: false }
    }
}

impl Envelope {
    /// Returns bounds that also contain frames without the denoiser if it has a history. A session measures the errors
    /// of such denoisers against them.
    pub fn with_unfiltered(self) -> Self {
        let is_measured = self.most.filter.is_some_and(|filter| filter.denoiser.keeps_history());
        Self { mixes_filter: self.mixes_filter || is_measured, ..self }
    }

    /// Checks that a frame of a run with these bounds can have a quality.
    ///
    /// # Errors
    /// The errors of [`Quality::check`], and [`SettingError::OutsideEnvelope`] if there are more samples or denoiser
    /// iterations, another denoiser or polar projection, one sample per pixel where all pixels have several, a render
    /// scale below 1 if the envelope has neither such a scale nor foveal layers, or foveal layers if it has none.
    pub fn check(&self, quality: &Quality) -> Result<(), SettingError> {
        quality.check()?;
        let Self { most, .. } = self;
        let outside = |is_outside: bool, setting: &dyn Fn() -> String| match is_outside {
            true => Err(SettingError::OutsideEnvelope(setting())),
            false => Ok(()),
        };
        let (spp, most_spp) = (quality.spp, most.spp);
        outside(spp.least > most_spp.least, &|| format!("{spp} samples per pixel, but for up to {most_spp}"))?;
        outside(spp.fraction() > most_spp.fraction(), &|| "pixels that differ in samples".to_owned())?;
        outside(spp.least == 1 && !self.centres_one(), &|| "one sample per pixel".to_owned())?;
        outside(quality.scale < 1.0 && !self.leaves_pixels(), &|| format!("a render scale of {}", quality.scale))?;
        outside(quality.fovea.is_some() && most.fovea.is_none(), &|| "foveal layers".to_owned())?;
        outside(quality.polar != most.polar, &|| "this polar projection".to_owned())?;
        let [asked, built] = [quality, most].map(|quality| Denoiser::name_of(quality.denoiser()));
        let is_built = asked == built || (quality.filter.is_none() && self.mixes_filter);
        outside(!is_built, &|| format!("the denoiser {asked}, but for {built}"))?;
        let (asked, built) = (quality.most_iterations(), most.most_iterations());
        outside(asked > built, &|| format!("{asked} denoiser iterations, but for up to {built}"))
    }

    /// Returns the numbers of denoiser iterations that frames may have.
    pub fn iterations(&self) -> RangeInclusive<u32> {
        let most = self.most.most_iterations();
        (if self.mixes_filter { 0 } else { most.min(1) })..=most
    }

    /// Returns true if pixels may be left unsampled for the filter to fill. A stage then lists the sampled ones.
    pub fn leaves_pixels(&self) -> bool {
        self.most.scale < 1.0 || self.most.fovea.is_some()
    }

    /// Returns true if a pixel's only sample is at its centre. Several are always jittered.
    pub fn centres_one(&self) -> bool {
        self.mixes_spp || self.most.spp.least == 1
    }

    /// Returns whether samples are jittered, in each kind of launch that frames may have.
    pub fn jitters(&self) -> &'static [bool] {
        match (self.centres_one(), self.mixes_spp) {
            (_, true) => &[false, true],
            (false, false) => &[true],
            (true, false) => &[false],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn envelope_covers_its_qualities() {
        let basic = Quality::default();
        let filter = Some(Filter { iterations: [2, 3, 4], ..Filter::DEFAULT });
        let all = [Quality { spp: 4.into(), filter, ..basic }, Quality { scale: 0.5, bounces: 2, ..basic }];
        let envelope @ Envelope { most, mixes_spp, .. } = Envelope::of(&all);
        assert_eq!((most.spp.least, most.bounces, most.iterations(), most.scale, mixes_spp), (4, 6, [5; 3], 0.5, true));
        assert!(!Envelope::of(&all[..1]).mixes_spp);
        let plain = Quality { filter: None, ..basic };
        assert!(envelope.check(&plain).is_err() && envelope.iterations() == (1..=5));
        let mixed = Envelope::of(&[all[0], all[1], plain]);
        assert!(mixed.check(&plain).is_ok() && mixed.iterations() == (0..=5));
        assert_eq!(Envelope::of(&[]), Envelope::from(basic));
    }
}
