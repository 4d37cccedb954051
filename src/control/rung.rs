//! A rung of the quality ladder: settings with their time and error, in memory and in a file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::projection::within;
use crate::quality::{Quality, SettingError};
use crate::samples::Samples;

/// The measure of the errors of a ladder's rungs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Measure {
    /// FLIP of single frames. Ladders that do not name their measure have this one.
    #[default]
    Flip,
    /// FLIP of frames plus the flicker between them, as means over consecutive frames, as `play` shows them.
    FlipFlicker,
    /// The value of a formula that orders settings. No images were compared.
    Estimate,
}

impl Measure {
    /// Returns the name of the measure.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flip => "FLIP",
            Self::FlipFlicker => "FLIP + flicker",
            Self::Estimate => "estimate",
        }
    }
}

/// Settings with their time and error.
#[derive(Clone, Debug, PartialEq)]
pub struct Rung {
    /// Median makespan. For estimated rungs, it is the prediction of the cost model.
    pub time_ms: f64,
    /// The error by the ladder's [`Measure`], mean over both eyes, 0 ..= 2. Rungs are ordered by it.
    pub error: f64,
    /// FLIP, as the mean over both eyes; `None` if not measured. The same applies to `flicker` and `relmse`.
    pub flip: Option<f64>,
    pub flicker: Option<f64>,
    pub relmse: Option<f64>,
    /// True if time and error were estimated, not measured.
    pub is_estimated: bool,
    pub quality: Quality,
    /// Busy time by stage, summed over views and devices, which a cost model can scale.
    pub stage_ms: BTreeMap<String, f64>,
    /// Rays per pixel by stage, for stages that trace paths. Empty in older ladders.
    pub rays: BTreeMap<String, f64>,
}

/// Serialized form of a rung. The names of estimated values start with `estimated_`.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileRung {
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    estimated: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    time_ms: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    estimated_ms: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    estimated_error: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    flicker: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    relmse: Option<f64>,
    #[serde(rename = "knobs")]
    quality: Option<Quality>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    stage_ms: BTreeMap<String, f64>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    estimated_stage_ms: BTreeMap<String, f64>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    rays: BTreeMap<String, f64>,
}

impl FileRung {
    pub fn of(rung: &Rung) -> Self {
        let Rung { time_ms, error, flip, flicker, relmse, is_estimated, quality, stage_ms, rays } = rung.clone();
        let shared = Self { quality: Some(quality), flip, flicker, relmse, rays, ..Self::default() };
        let (time_ms, error) = (Some(time_ms), Some(error));
        match is_estimated {
            true => Self {
                estimated: true,
                estimated_ms: time_ms,
                estimated_error: error,
                estimated_stage_ms: stage_ms,
                ..shared
            },
            false => Self { time_ms, error, stage_ms, ..shared },
        }
    }

    /// Returns the rung, as part of a ladder with this measure. Ladders that do not name their measure store the error
    /// only as `flip`.
    pub fn rung(self, measure: Measure) -> Result<Rung, String> {
        let Self { estimated, flip, flicker, relmse, rays, .. } = self;
        let missing = |name: &str| format!("it has no {name}");
        let (time_ms, error, stage_ms) = match estimated {
            true => (
                self.estimated_ms.ok_or_else(|| missing("estimated_ms"))?,
                self.estimated_error.ok_or_else(|| missing("estimated_error"))?,
                self.estimated_stage_ms,
            ),
            false => (
                self.time_ms.ok_or_else(|| missing("time_ms"))?,
                match measure {
                    Measure::Flip => self.error.or(flip).ok_or_else(|| missing("flip"))?,
                    _ => self.error.ok_or_else(|| missing("error"))?,
                },
                self.stage_ms,
            ),
        };
        let quality = self.quality.ok_or_else(|| missing("knobs"))?;
        Ok(Rung { time_ms, error, flip, flicker, relmse, is_estimated: estimated, quality, stage_ms, rays })
    }
}

/// Returns the values of `a` and `b` at the fraction `part` of the way between them, for keys that both have.
pub fn mix(a: &BTreeMap<String, f64>, b: &BTreeMap<String, f64>, part: f64) -> BTreeMap<String, f64> {
    a.iter().filter_map(|(key, a)| Some((key.clone(), a + (b.get(key)? - a) * part))).collect()
}

impl Rung {
    /// Returns the rung with `samples` per pixel between this one and `above`; `None` unless these differ in nothing but
    /// their samples and `samples` is between theirs. Times grow linearly with samples, errors fall as a power of them.
    pub fn between(&self, above: &Self, spp: Samples) -> Option<Self> {
        let [low, high, mean] = [self.quality.spp, above.quality.spp, spp].map(Samples::mean);
        let quality = Quality { spp, ..self.quality };
        if quality != (Quality { spp, ..above.quality }) || !(low < mean && mean < high) {
            return None;
        }
        let part = (mean - low) / (high - low);
        let power = (mean / low).ln() / (high / low).ln();
        let fall = |below: f64, above: f64| below * (above / below).powf(power);
        Some(Self {
            time_ms: self.time_ms + (above.time_ms - self.time_ms) * part,
            error: fall(self.error, above.error),
            flip: None,
            flicker: None,
            relmse: None,
            is_estimated: true,
            quality,
            stage_ms: mix(&self.stage_ms, &above.stage_ms, part),
            rays: mix(&self.rays, &above.rays, part),
        })
    }

    pub(super) fn check(&self) -> Result<(), SettingError> {
        self.quality.check()?;
        let [time_ms, error] = match self.is_estimated {
            true => ["estimated_ms", "estimated_error"],
            false => ["time_ms", "error"],
        };
        within(time_ms, self.time_ms, f64::MIN_POSITIVE..=f64::MAX)?;
        within(error, self.error, 0.0..=2.0)?;
        for (name, value, most) in
            [("flip", self.flip, 1.0), ("flicker", self.flicker, 1.0), ("relmse", self.relmse, f64::MAX)]
        {
            value.map_or(Ok(()), |value| within(name, value, 0.0..=most))?;
        }
        let mut by_stage = self.stage_ms.iter().chain(&self.rays);
        Ok(by_stage.try_for_each(|(stage, &value)| within(stage, value, 0.0..=f64::MAX))?)
    }

    pub(super) fn check_above(&self, below: &Self) -> Result<(), String> {
        if self.time_ms <= below.time_ms {
            return Err(format!(
                "its {} ms are not more than the {} ms of the rung before",
                self.time_ms, below.time_ms
            ));
        }
        if self.error >= below.error {
            return Err(format!("its error, {}, is not below the {} of the rung before", self.error, below.error));
        }
        Ok(())
    }
}
