//! Quality settings of a frame: the types that ladders, reports, traces, `bench` and the renderer share.

mod envelope;
mod error;
mod file;

use std::fmt::{self, Display};
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::projection::within;
use crate::samples;
use crate::samples::Samples;

pub use crate::passes::denoise::{Denoiser, Filter};
pub use crate::projection::{LogPolar, PolarSpace};
pub use envelope::Envelope;
pub use error::SettingError;

/// A denoiser or none. The name hides the `Option` from argument parsers, which would make the argument optional.
pub type DenoiserChoice = Option<Denoiser>;

/// Settings that determine the quality of a frame. Ladder files call them `knobs`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "file::Members", into = "file::Members")]
pub struct Quality {
    /// Samples per traced pixel.
    pub spp: Samples,
    /// Maximum bounces. Direct light is always included, so 0 and 1 are equivalent.
    pub bounces: u32,
    /// How frames are denoised, if they are.
    pub filter: Option<Filter>,
    /// Radii at which the inner and the middle foveal layer end, in increasing order, as fractions of the eye's width.
    /// Without them, the whole image belongs to the inner layer.
    pub fovea: Option<[f64; 2]>,
    /// Polar projection that is traced instead of the screen's pixels, if any.
    pub polar: Option<PolarSpace>,
    /// Per-axis render scale, within [`Self::SCALES`]. Scale² of the pixels are path traced, and the denoiser fills in
    /// the rest, guided by a full-resolution G-buffer.
    pub scale: f64,
}

impl Default for Quality {
    /// Returns the quality of `diptych render` by default: 1 sample, 6 bounces, and svgf with 5 iterations.
    fn default() -> Self {
        Self { spp: Samples::ONE, bounces: 6, filter: Some(Filter::DEFAULT), fovea: None, polar: None, scale: 1.0 }
    }
}

impl Quality {
    /// Valid render scales.
    pub const SCALES: RangeInclusive<f64> = 0.1..=1.0;

    /// Returns the denoiser, if frames are denoised.
    pub fn denoiser(&self) -> Option<Denoiser> {
        self.filter.map(|filter| filter.denoiser)
    }

    /// Returns the filter's iterations in the inner, middle and outer foveal layer, 0 without a filter.
    pub fn iterations(&self) -> [u32; 3] {
        self.filter.map_or([0; 3], |filter| filter.iterations)
    }

    /// Returns the largest number of iterations of any foveal layer, 0 without a filter.
    pub fn most_iterations(&self) -> u32 {
        self.filter.map_or(0, Filter::most_iterations)
    }

    /// Checks whether all settings are valid, alone and together.
    ///
    /// # Errors
    /// [`SettingError`], except for [`SettingError::OutsideEnvelope`].
    pub fn check(&self) -> Result<(), SettingError> {
        self.spp.check()?;
        within("bounces", self.bounces, 0..=1024)?;
        if let Some(filter) = self.filter {
            within("iterations", filter.most_iterations(), 1..=filter.denoiser.most_iterations())?;
        }
        within("scale", self.scale, Self::SCALES)?;
        if self.polar.is_some() && self.fovea.is_some() {
            return Err(SettingError::PolarWithFovea);
        }
        if let Some(space) = self.polar {
            space.method().check()?;
        }
        if let Some([inner, outer]) = self.fovea {
            within("fovea's inner radius", inner, f64::MIN_POSITIVE..=1.0)?;
            within("fovea's outer radius", outer, inner..=1.0)?;
        }
        if self.filter.is_none() && self.scale < 1.0 {
            return Err(SettingError::ScaleWithoutDenoiser);
        }
        Ok(())
    }
}

impl Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { spp, bounces, scale, .. } = *self;
        write!(f, "{} x{}, {bounces} bounces, {spp} spp", Denoiser::name_of(self.denoiser()), self.most_iterations())?;
        let scale = if scale < 1.0 { format!(", scale {scale}") } else { String::new() };
        let polar = self.polar.map_or(String::new(), |space| format!(", {space}"));
        write!(f, "{scale}{}{polar}", layers_name(self.fovea))
    }
}

/// The part of [`Quality`] that `run.json`, `frames.csv` and journals record for each frame. It leaves out the denoiser
/// and the projection, which all frames of a run share. `iterations` is the maximum over the foveal layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FrameQuality {
    /// Samples per traced pixel.
    #[serde(flatten, serialize_with = "samples::as_members")]
    #[cfg_attr(feature = "schema", schemars(with = "samples::Members"))]
    pub spp: Samples,
    pub bounces: u32,
    pub iterations: u32,
    /// Per-axis render scale. 1 is full size.
    pub scale: f64,
    /// Radii of the foveal layers, as fractions of the width.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fovea: Option<[f64; 2]>,
}

impl FrameQuality {
    /// Returns the mean number of samples per pixel at this render scale. Foveation, which would reduce it further, is
    /// not taken into account.
    pub fn samples(&self) -> f64 {
        self.spp.mean() * self.scale * self.scale
    }
}

impl From<&Quality> for FrameQuality {
    fn from(quality: &Quality) -> Self {
        let Quality { spp, bounces, fovea, scale, .. } = *quality;
        Self { spp, bounces, iterations: quality.most_iterations(), scale, fovea }
    }
}

impl Display for FrameQuality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { spp, bounces, iterations, scale, fovea } = *self;
        let layers = layers_name(fovea);
        write!(f, "{spp} spp, {bounces} bounces, {iterations} iterations, scale {scale}{layers}")
    }
}

fn layers_name(fovea: Option<[f64; 2]>) -> String {
    fovea.map_or(String::new(), |[inner, outer]| format!(", layers to {inner} and {outer}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_json_merges_equal_iterations_of_layers() {
        let quality = Quality { spp: 2.into(), fovea: Some([0.15, 0.3]), scale: 0.5, ..Quality::default() };
        let text = r#"{"spp":2,"bounces":6,"denoiser":"svgf","iterations":5,"fovea":[0.15,0.3],"scale":0.5}"#;
        assert_eq!(serde_json::to_string(&quality).unwrap(), text);
        assert_eq!(serde_json::from_str::<Quality>(text).unwrap(), quality);
        let filter = Some(Filter { iterations: [2, 3, 5], ..Filter::DEFAULT });
        let layers = Quality { filter, ..quality };
        let text = text.replace(":5,", ":[2,3,5],");
        assert_eq!(serde_json::to_string(&layers).unwrap(), text);
        assert_eq!(serde_json::from_str::<Quality>(&text).unwrap(), layers);
        assert_eq!(FrameQuality::from(&quality), FrameQuality::from(&layers));
        assert_eq!(quality.to_string(), "svgf x5, 6 bounces, 2 spp, scale 0.5, layers to 0.15 and 0.3");
    }
}
