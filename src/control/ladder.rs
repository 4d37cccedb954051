//! The quality ladder: settings by rising time and falling error, and its file format.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::rung::{FileRung, Measure, Rung};
use super::{front, mean_error};
use crate::image::ImageError;
use crate::image::file::atomic_write;
use crate::quality::Denoiser;
use crate::samples::Samples;

/// Relative difference in time below which measurements cannot distinguish two rungs of a front.
pub const MIN_STEP: f64 = 0.03;
/// Relative difference in time that [`Ladder::refined`] allows between rungs.
pub const FINE_STEP: f64 = 0.05;
/// Exponent of the limit on a rung's error: if a rung is s times as fast as the next one up, its error may be at most s
/// to this power times as large. With a larger error, the rung is worse than one with fewer samples.
pub const STEEPEST: f64 = 3.0;

/// Suffix of [`Origin::version`] in ladders that older versions of `play` wrote. They store estimated errors as `flip`.
const ESTIMATED_FLIP: &str = "; flip is estimated";

#[derive(Debug, thiserror::Error)]
pub enum LadderError {
    #[error("cannot read the ladder file {path}")]
    Read { path: PathBuf, source: io::Error },
    #[error("{path} is not a quality ladder: make one with `diptych bench`")]
    File { path: PathBuf, source: Box<LadderError> },
    #[error("not a valid ladder file: {0}")]
    Form(Box<toml::de::Error>),
    #[error("the ladder has no rungs")]
    Empty,
    #[error("rung {number}: {what}")]
    Rung { number: usize, what: String },
    #[error("cannot write the ladder as TOML: {0}")]
    Format(toml::ser::Error),
    #[error(transparent)]
    Write(#[from] ImageError),
}

/// The conditions under which a ladder was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    pub shot: String,
    /// The size of each eye.
    pub size: String,
    /// The exposure at which images were compared.
    #[serde(default)]
    pub exposure_ev: f64,
    /// The measure of the rungs' errors.
    #[serde(default)]
    pub measure: Measure,
    pub devices: Vec<String>,
    /// The version of diptych.
    pub version: String,
}

/// Quality ladder: at least one rung, in the order of strictly rising time and strictly falling error.
#[derive(Clone, Debug, PartialEq)]
pub struct Ladder {
    origin: Origin,
    rungs: Vec<Rung>,
}

/// Contents of a ladder file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    origin: Origin,
    #[serde(default)]
    rung: Vec<FileRung>,
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
            let check = rung.check().map_err(|error| error.to_string());
            let check = check.and_then(|()| below.map_or(Ok(()), |below| rung.check_above(below)));
            check.map_err(|what| LadderError::Rung { number: i + 1, what })?;
        }
        Ok(Self { origin, rungs })
    }

    /// Builds a ladder from the Pareto front of time and error. If two rungs are closer than [`MIN_STEP`], or a step
    /// down costs too much quality for the time it saves ([`STEEPEST`]), only the better one stays. Measurements that
    /// are not finite are ignored.
    ///
    /// # Errors
    /// The errors of [`Self::new`]: [`LadderError::Empty`] and [`LadderError::Rung`].
    pub fn of_measured(origin: Origin, measured: &[Rung]) -> Result<Self, LadderError> {
        let points: Vec<(f64, f64)> = measured.iter().map(|r| (r.time_ms, r.error)).collect();
        let mut rungs: Vec<Rung> = Vec::new();
        for &i in front(&points).iter().rev() {
            let is_worth = |above: &Rung| {
                let [saved, lost] = [above.time_ms / measured[i].time_ms, measured[i].error / above.error.max(1e-6)];
                saved >= 1.0 + MIN_STEP && lost <= saved.powf(STEEPEST)
            };
            if rungs.last().is_none_or(is_worth) && measured[i].check().is_ok() {
                rungs.push(measured[i].clone());
            }
        }
        rungs.reverse();
        Self::new(origin, rungs)
    }

    /// Adds rungs between measured ones that differ in nothing but their samples ([`Rung::between`]), so that times rise
    /// by 5 % at most. The times and errors of these rungs are estimates.
    #[must_use]
    pub fn refined(self) -> Self {
        let mut rungs = Vec::with_capacity(self.rungs.len());
        for (i, rung) in self.rungs.iter().enumerate() {
            rungs.push(rung.clone());
            let Some(above) = self.rungs.get(i + 1) else { break };
            if rung.is_estimated || above.is_estimated {
                continue;
            }
            let ratio = above.time_ms / rung.time_ms;
            let steps = (ratio.ln() / FINE_STEP.ln_1p()).ceil();
            let [low, high] = [rung, above].map(|r| r.quality.spp.mean());
            let samples = (1..steps as u32).map(|step| {
                let part = (ratio.powf(f64::from(step) / steps) - 1.0) / (ratio - 1.0);
                let mean = low + (high - low) * part;
                Samples::of_mean(mean)
            });
            rungs.extend(samples.filter_map(|samples| rung.between(above, samples)));
        }
        // Times of neighbours may differ by less than rounding allows.
        let is_ladder = |rungs: &[Rung]| rungs.windows(2).all(|pair| pair[1].check_above(&pair[0]).is_ok());
        if is_ladder(&rungs) { Self { rungs, ..self } } else { self }
    }

    /// Builds a ladder for each measured denoiser ([`Self::of_measured`]), best denoiser first. Denoisers are ranked by
    /// their `mean_error` between the shortest and the longest time measured with any of them. Denoisers without a
    /// finite measurement have no ladder.
    ///
    /// # Errors
    /// [`LadderError::Empty`] if no denoiser has a ladder.
    pub fn by_denoiser(origin: &Origin, measured: &[Rung]) -> Result<Vec<Self>, LadderError> {
        let points = |rungs: &[Rung]| -> Vec<(f64, f64)> { rungs.iter().map(|r| (r.time_ms, r.error)).collect() };
        let all: Vec<(f64, f64)> =
            points(measured).into_iter().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
        let fastest = all.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
        let slowest = all.iter().map(|p| p.0).fold(0.0, f64::max);
        let worst = all.iter().map(|p| p.1).fold(0.0, f64::max);
        let mut ladders: Vec<(f64, Self)> = Vec::new();
        for denoiser in Denoiser::choices() {
            let own: Vec<Rung> = measured.iter().filter(|r| r.quality.denoiser() == denoiser).cloned().collect();
            if let Ok(ladder) = Self::of_measured(origin.clone(), &own) {
                ladders.push((mean_error(&points(&own), [fastest, slowest], worst), ladder));
            }
        }
        ladders.sort_by(|a, b| a.0.total_cmp(&b.0));
        if ladders.is_empty() { Err(LadderError::Empty) } else { Ok(ladders.into_iter().map(|(_, l)| l).collect()) }
    }

    /// Parses the text of a ladder's file.
    ///
    /// # Errors
    /// [`LadderError::Form`], and those of [`Self::new`].
    pub fn parse(text: &str) -> Result<Self, LadderError> {
        let File { mut origin, rung } = toml::from_str(text).map_err(|error| LadderError::Form(Box::new(error)))?;
        let checked = |(i, rung): (usize, FileRung)| {
            rung.rung(origin.measure).map_err(|what| LadderError::Rung { number: i + 1, what })
        };
        let mut rungs = rung.into_iter().enumerate().map(checked).collect::<Result<Vec<Rung>, _>>()?;
        if origin.version.ends_with(ESTIMATED_FLIP) {
            origin.measure = Measure::Estimate;
            rungs.iter_mut().for_each(|rung| (rung.flip, rung.is_estimated) = (None, true));
        }
        Self::new(origin, rungs)
    }

    /// # Errors
    /// [`LadderError::Read`], [`LadderError::File`].
    pub fn read(path: &Path) -> Result<Self, LadderError> {
        let read = |source| LadderError::Read { path: path.to_owned(), source };
        let text = std::fs::read_to_string(path).map_err(read)?;
        Self::parse(&text).map_err(|source| LadderError::File { path: path.to_owned(), source: Box::new(source) })
    }

    /// Returns the ladder as text that [`Self::parse`] reads.
    ///
    /// # Errors
    /// [`LadderError::Format`].
    pub fn text(&self) -> Result<String, LadderError> {
        let rung = self.rungs.iter().map(FileRung::of).collect();
        toml::to_string_pretty(&File { origin: self.origin.clone(), rung }).map_err(LadderError::Format)
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

    /// Returns the denoisers of the ladder, each with its number of rungs, in the order of their first rungs.
    pub fn denoisers(&self) -> Vec<(Option<Denoiser>, usize)> {
        let mut counts: Vec<(Option<Denoiser>, usize)> = Vec::new();
        for rung in &self.rungs {
            match counts.iter_mut().find(|(denoiser, _)| *denoiser == rung.quality.denoiser()) {
                Some((_, count)) => *count += 1,
                None => counts.push((rung.quality.denoiser(), 1)),
            }
        }
        counts
    }

    /// Returns the rungs from the cheapest to the best.
    pub fn rungs(&self) -> &[Rung] {
        &self.rungs
    }
}
