//! Results of the grid's settings.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::errors::{ERROR, Errors, FLICKER, SeenErrors};
use crate::report::frames::FrameLine;
use crate::report::intervals::positive_interval;
use crate::report::median_of;
use diptych::control::Rung;
use diptych::exec::{FrameReport, PerView};
use diptych::metrics::temporal::Change;
use diptych::quality::Quality;
use diptych::scene::rig::Eye;

/// A timed frame of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timed {
    /// Busy time by stage, summed over views and devices.
    pub stage_ms: BTreeMap<String, f64>,
    /// Rays per pixel by stage, for stages that trace paths.
    pub rays: BTreeMap<String, f64>,
    /// The line of this frame in `frames.csv`.
    pub line: FrameLine,
}

impl Timed {
    pub fn new(frame: &FrameReport, line: FrameLine) -> Self {
        Self { stage_ms: frame.stage_ms(), rays: frame.stage_rays(), line }
    }
}

/// A frame of a setting that is compared with the reference.
#[derive(Clone, Debug)]
pub struct Repeat {
    pub timed: Timed,
    pub errors: PerView<SeenErrors>,
    /// Change of each eye's image since the previous frame; `None` for the first.
    pub change: Option<PerView<Change>>,
}

/// Results of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Median, minimum and maximum of the repeats' makespans.
    pub time_ms: f64,
    pub time_ms_min: f64,
    pub time_ms_max: f64,
    /// Busy time by stage: the median over the repeats that ran the stage.
    pub stage_ms: BTreeMap<String, f64>,
    /// Rays per pixel of stages that trace paths: the median over these repeats.
    #[serde(default)]
    pub rays: BTreeMap<String, f64>,
    pub errors: PerView<Errors>,
    /// Errors of each compared frame. Its flicker is the mean over its changes from the frame before and to the next.
    pub repeats: Vec<PerView<Errors>>,
    /// Line of each timed frame in `frames.csv`.
    pub frames: Vec<FrameLine>,
}

impl Measured {
    /// Combines the frames of a setting. The camera is at rest while they change.
    pub fn of(repeats: &[Repeat]) -> Self {
        let timed: Vec<Timed> = repeats.iter().map(|r| r.timed.clone()).collect();
        let of_eye = |r: &Repeat, eye| (*r.errors.of(eye), r.change.as_ref().map(|change| *change.of(eye)));
        let errors = |eye: Eye| Errors::of(repeats.iter().map(|repeat| of_eye(repeat, eye)));
        let [left, right] = [errors(Eye::LEFT), errors(Eye::RIGHT)];
        let both = left.1.into_iter().zip(right.1);
        let unknown = Self {
            time_ms: 0.0,
            time_ms_min: 0.0,
            time_ms_max: 0.0,
            stage_ms: BTreeMap::new(),
            rays: BTreeMap::new(),
            errors: PerView::both(left.0, right.0),
            repeats: both.map(|(left, right)| PerView::both(left, right)).collect(),
            frames: Vec::new(),
        };
        unknown.timed(&timed)
    }

    /// Replaces the times by those of other frames, one for each turn.
    #[must_use]
    pub fn timed(self, frames: &[Timed]) -> Self {
        let times_ms: Vec<f64> = frames.iter().map(|f| f.line.makespan_ms).collect();
        Self {
            time_ms_min: times_ms.iter().copied().fold(f64::INFINITY, f64::min),
            time_ms_max: times_ms.iter().copied().fold(0.0, f64::max),
            time_ms: median_of(times_ms),
            stage_ms: medians(frames, |f| &f.stage_ms),
            rays: medians(frames, |f| &f.rays),
            frames: frames.iter().map(|f| f.line.clone()).collect(),
            ..self
        }
    }

    /// Returns the makespan of each timed frame.
    pub fn times_ms(&self) -> Vec<f64> {
        self.frames.iter().map(|line| line.makespan_ms).collect()
    }

    /// Returns the mean over both eyes of the error `name`, for each compared frame.
    pub fn errors_of(&self, name: &str) -> Vec<f64> {
        let eye = |errors: &Errors| errors.get(name).unwrap_or(f64::NAN);
        self.repeats.iter().map(|both| (eye(both.left()) + eye(both.right())) / 2.0).collect()
    }

    /// Returns the ends of the 95 % interval of the time.
    pub fn time_interval(&self) -> Option<[f64; 2]> {
        positive_interval(self.times_ms())
    }

    /// Returns the mean over both eyes of the error `name`; infinite if it is undefined in one eye.
    pub fn error(&self, name: &str) -> f64 {
        let [l, r] = [self.errors.left(), self.errors.right()].map(|e| e.get(name).unwrap_or(f64::INFINITY));
        (l + r) / 2.0
    }
}

/// Returns the median of each stage's value over the frames that ran the stage.
fn medians(frames: &[Timed], of: fn(&Timed) -> &BTreeMap<String, f64>) -> BTreeMap<String, f64> {
    let median = |stage: &String| median_of(frames.iter().filter_map(|f| of(f).get(stage).copied()).collect());
    frames.iter().flat_map(|f| of(f).keys()).map(|stage| (stage.clone(), median(stage))).collect()
}

/// A setting with its results.
#[derive(Clone, Debug, Serialize)]
pub struct SettingRow {
    #[serde(flatten)]
    pub quality: Quality,
    #[serde(flatten)]
    pub measured: Measured,
    /// True on the front of time and [`ERROR`] that the intervals show.
    pub on_front: bool,
    /// True if the intervals leave open whether the setting belongs on the front.
    pub undecided: bool,
}

impl SettingRow {
    pub fn new(quality: Quality, measured: Measured) -> Self {
        Self { quality, measured, on_front: false, undecided: false }
    }

    pub fn rung(&self) -> Rung {
        let Measured { time_ms, stage_ms, rays, .. } = &self.measured;
        let [flip, flicker, relmse] = ["flip", FLICKER, "relmse"].map(|name| Some(self.measured.error(name)));
        let (quality, error) = (self.quality, self.measured.error(ERROR));
        let (stage_ms, rays) = (stage_ms.clone(), rays.clone());
        Rung { time_ms: *time_ms, error, flip, flicker, relmse, is_estimated: false, quality, stage_ms, rays }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use diptych::image::{Extent, RgbImage};
    use diptych::metrics::Pair;
    use diptych::metrics::rings::Viewing;
    use diptych::quality::{Denoiser, Filter, FrameQuality};

    /// Makes a row of frames with these values of RMSE in the left eye and twice these in the right eye.
    pub fn row(denoiser: &str, spp: u32, time_ms: f64, rmse: &[f64]) -> SettingRow {
        let filter = Denoiser::from_name(denoiser).unwrap().map(|denoiser| Filter::new(denoiser, 1));
        let quality = Quality { spp: spp.into(), filter, ..Quality::default() };
        let black = RgbImage::filled(Extent::new(12, 12), [0.0; 3]);
        let viewing = Viewing { gaze: [0.5; 2], yfov_deg: 70.0 };
        let flat = |v: f64| {
            let pair = Pair::new(&black, &RgbImage::filled(black.extent, [v as f32; 3]), 0.0).unwrap();
            SeenErrors::new(&pair, &viewing)
        };
        let pair = || Pair::new(&black, &black, 0.0).unwrap();
        let change = pair().change_at_rest(&pair()).unwrap();
        let repeat = |v: &f64| Repeat {
            timed: timed(&quality, time_ms),
            errors: PerView::both(flat(*v), flat(2.0 * v)),
            change: Some(PerView::both(change, change)),
        };
        let repeats: Vec<Repeat> = rmse.iter().map(repeat).collect();
        SettingRow::new(quality, Measured::of(&repeats))
    }

    fn timed(quality: &Quality, time_ms: f64) -> Timed {
        Timed {
            stage_ms: [("atrous".to_owned(), time_ms / 4.0)].into(),
            rays: BTreeMap::new(),
            line: FrameLine { makespan_ms: time_ms, quality: FrameQuality::from(quality), ..FrameLine::default() },
        }
    }

    /// Makes a row that takes these times in turns, with an RMSE that scatters by 0.1 % between frames.
    pub fn row_in_turns(denoiser: &str, spp: u32, times_ms: &[f64], rmse: f64) -> SettingRow {
        let SettingRow { quality, measured, .. } = row(denoiser, spp, 1.0, &[1.0, 1.001, 0.999].map(|f| f * rmse));
        let frames: Vec<Timed> = times_ms.iter().map(|ms| timed(&quality, *ms)).collect();
        SettingRow::new(quality, measured.timed(&frames))
    }
}
