//! The quality ladder: settings by rising time and falling error, and the file that they are kept in.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::front;
use crate::image::ImageError;
use crate::image::file::atomic_write;

/// Rungs of a front that are less than this apart in time, as a share, are not told apart by measurement.
pub const MIN_STEP: f64 = 0.03;
/// A rung below another one may have this power of the factor that it saves in time as a factor on the error: who would
/// take three times the error for a tenth of the time had better leave out samples.
pub const STEEPEST: f64 = 3.0;

/// Render scales that may be asked for.
pub const SCALES: RangeInclusive<f64> = 0.1..=1.0;

#[derive(Debug, thiserror::Error)]
pub enum LadderError {
    #[error("cannot read the ladder {path}")]
    Read { path: PathBuf, source: io::Error },
    #[error("{path} is no ladder: make one with `diptych bench`")]
    File { path: PathBuf, source: Box<LadderError> },
    #[error("it does not have a ladder's form: {0}")]
    Form(#[from] Box<toml::de::Error>),
    #[error("it has no rungs")]
    Empty,
    #[error("rung {number}: {what}")]
    Rung { number: usize, what: String },
    #[error("cannot write the ladder as TOML: {0}")]
    Format(#[from] toml::ser::Error),
    #[error(transparent)]
    Write(#[from] ImageError),
}

/// What a frame's quality and cost hang on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Knobs {
    /// Samples per pixel.
    pub spp: u32,
    pub bounces: u32,
    /// As the command line names it.
    pub denoiser: String,
    /// Of the denoiser; 0 with `none`.
    pub iterations: u32,
    /// Radii of the foveal layers as shares of the eye's width; none: the whole image alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fovea: Option<[f64; 2]>,
    /// Of the image's edges, 1: full size.
    pub scale: f64,
}

/// Settings with what they cost and how wrong they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rung {
    /// Median makespan.
    pub time_ms: f64,
    /// Means over both eyes.
    pub flip: f64,
    /// `None` where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relmse: Option<f64>,
    pub knobs: Knobs,
    /// Busy time by stage, summed over views and devices: what a cost model can scale.
    #[serde(default)]
    pub stage_ms: BTreeMap<String, f64>,
}

/// What a ladder was measured on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    pub shot: String,
    /// Of each eye.
    pub size: String,
    /// At which images were shown to be judged by FLIP.
    #[serde(default)]
    pub exposure_ev: f64,
    pub devices: Vec<String>,
    /// Of diptych.
    pub version: String,
}

/// Rungs by strictly rising time and strictly falling FLIP; there is one at least.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ladder {
    origin: Origin,
    #[serde(rename = "rung")]
    rungs: Vec<Rung>,
}

/// As it is in a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Unchecked {
    origin: Origin,
    #[serde(default)]
    rung: Vec<Rung>,
}

impl Ladder {
    /// # Errors
    /// [`LadderError::Empty`], and [`LadderError::Rung`] for the first rung that is out of range or out of order.
    pub fn new(origin: Origin, rungs: Vec<Rung>) -> Result<Self, LadderError> {
        if rungs.is_empty() {
            return Err(LadderError::Empty);
        }
        for (i, rung) in rungs.iter().enumerate() {
            let below = i.checked_sub(1).map(|i| &rungs[i]);
            let check = rung.check().and_then(|()| below.map_or(Ok(()), |below| rung.check_above(below)));
            check.map_err(|what| LadderError::Rung { number: i + 1, what })?;
        }
        Ok(Self { origin, rungs })
    }

    /// The Pareto front of time and FLIP. Of rungs closer than [`MIN_STEP`], and where a step down saves too little for
    /// what it costs ([`STEEPEST`]), the better ones stay. What was not measured in finite numbers is left out.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_measured(origin: Origin, measured: &[Rung]) -> Result<Self, LadderError> {
        let points: Vec<(f64, f64)> = measured.iter().map(|r| (r.time_ms, r.flip)).collect();
        let mut rungs: Vec<Rung> = Vec::new();
        for &i in front(&points).iter().rev() {
            let is_worth = |above: &Rung| {
                let [saved, lost] = [above.time_ms / measured[i].time_ms, measured[i].flip / above.flip.max(1e-6)];
                saved >= 1.0 + MIN_STEP && lost <= saved.powf(STEEPEST)
            };
            if rungs.last().is_none_or(is_worth) && measured[i].check().is_ok() {
                rungs.push(measured[i].clone());
            }
        }
        rungs.reverse();
        Self::new(origin, rungs)
    }

    /// From the text of a ladder's file.
    ///
    /// # Errors
    /// [`LadderError::Form`], and those of [`Self::new`].
    pub fn parse(text: &str) -> Result<Self, LadderError> {
        let Unchecked { origin, rung } = toml::from_str(text).map_err(Box::new)?;
        Self::new(origin, rung)
    }

    /// # Errors
    /// [`LadderError::Read`], [`LadderError::File`].
    pub fn read(path: &Path) -> Result<Self, LadderError> {
        let read = |source| LadderError::Read { path: path.to_owned(), source };
        let text = std::fs::read_to_string(path).map_err(read)?;
        Self::parse(&text).map_err(|source| LadderError::File { path: path.to_owned(), source: Box::new(source) })
    }

    /// The text that [`Self::parse`] reads.
    ///
    /// # Errors
    /// [`LadderError::Format`].
    pub fn text(&self) -> Result<String, LadderError> {
        Ok(toml::to_string_pretty(self)?)
    }

    /// # Errors
    /// [`LadderError::Format`], [`LadderError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), LadderError> {
        let text = self.text()?;
        Ok(atomic_write(path, |file| file.write_all(text.as_bytes()))?)
    }

    pub fn origin(&self) -> &Origin {
        &self.origin
    }

    /// From the cheapest to the best.
    pub fn rungs(&self) -> &[Rung] {
        &self.rungs
    }
}

impl Rung {
    fn check(&self) -> Result<(), String> {
        let Knobs { spp, bounces, denoiser, iterations, fovea, scale } = &self.knobs;
        within("spp", *spp, 1..=1 << 20)?;
        within("bounces", *bounces, 0..=1024)?;
        within("iterations", *iterations, 0..=10)?;
        within("scale", *scale, SCALES)?;
        if denoiser.is_empty() {
            return Err("denoiser is empty".to_owned());
        }
        if let Some([inner, outer]) = *fovea {
            within("fovea's inner radius", inner, f64::MIN_POSITIVE..=1.0)?;
            within("fovea's outer radius", outer, inner..=1.0)?;
        }
        within("time_ms", self.time_ms, f64::MIN_POSITIVE..=f64::MAX)?;
        within("flip", self.flip, 0.0..=1.0)?;
        self.relmse.map_or(Ok(()), |relmse| within("relmse", relmse, 0.0..=f64::MAX))?;
        self.stage_ms.iter().try_for_each(|(stage, &ms)| within(stage, ms, 0.0..=f64::MAX))
    }

    fn check_above(&self, below: &Self) -> Result<(), String> {
        if self.time_ms <= below.time_ms {
            return Err(format!(
                "its {} ms are not more than the {} ms of the rung before",
                self.time_ms, below.time_ms
            ));
        }
        if self.flip >= below.flip {
            return Err(format!("its FLIP, {}, is not below the {} of the rung before", self.flip, below.flip));
        }
        Ok(())
    }
}

fn within<T: PartialOrd + std::fmt::Display>(name: &str, value: T, range: RangeInclusive<T>) -> Result<(), String> {
    if range.contains(&value) { Ok(()) } else { Err(format!("{name} {value} is out of range")) }
}
