//! Results of the grid's settings, and their Pareto front.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::errors::{ERROR, Errors, FLICKER, SeenErrors};
use crate::report::frames::FrameLine;
use crate::report::median_of;
use diptych::control::{Rung, front};
use diptych::exec::{FrameReport, Stereo};
use diptych::metrics::temporal::{Change, TemporalError};
use diptych::quality::Quality;

/// One measured frame of a setting.
#[derive(Clone, Debug)]
pub struct Repeat {
    /// Busy time by stage, summed over views and devices.
    pub stage_ms: BTreeMap<String, f64>,
    /// Rays per pixel by stage, for stages that trace paths.
    pub rays: BTreeMap<String, f64>,
    pub errors: Stereo<SeenErrors>,
    /// The line of this frame in `frames.csv`.
    pub line: FrameLine,
}

impl Repeat {
    pub fn new(frame: &FrameReport, errors: Stereo<SeenErrors>, line: FrameLine) -> Self {
        Self { stage_ms: frame.stage_ms(), rays: frame.stage_rays(), errors, line }
    }
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
    pub errors: Stereo<Errors>,
    /// relMSE of each repeat.
    pub relmse_repeats: Stereo<Vec<f64>>,
    /// Line of each repeat in `frames.csv`.
    pub frames: Vec<FrameLine>,
}

impl Measured {
    /// Combines the frames of a setting. `changes` holds, for each eye, the change between consecutive frames while the
    /// camera is at rest.
    pub fn of(repeats: &[Repeat], changes: Stereo<Change>) -> Self {
        let times_ms: Vec<f64> = repeats.iter().map(|r| r.line.makespan_ms).collect();
        let eye = |of: fn(&Repeat) -> &SeenErrors| repeats.iter().map(|r| *of(r)).collect::<Vec<_>>();
        let found = Stereo { left: eye(|r| &r.errors.left), right: eye(|r| &r.errors.right) };
        let relmse = |c: &[SeenErrors]| c.iter().map(|c| c.all.relmse).collect();
        Self {
            time_ms_min: times_ms.iter().copied().fold(f64::INFINITY, f64::min),
            time_ms_max: times_ms.iter().copied().fold(0.0, f64::max),
            time_ms: median_of(times_ms),
            stage_ms: medians(repeats, |r| &r.stage_ms),
            rays: medians(repeats, |r| &r.rays),
            errors: Stereo {
                left: Errors::mean_of(&found.left).with_flicker(TemporalError::from(changes.left).flicker),
                right: Errors::mean_of(&found.right).with_flicker(TemporalError::from(changes.right).flicker),
            },
            relmse_repeats: Stereo { left: relmse(&found.left), right: relmse(&found.right) },
            frames: repeats.iter().map(|r| r.line.clone()).collect(),
        }
    }

    /// Returns the mean over both eyes of the error `name`; infinite if it is undefined in one eye.
    pub fn error(&self, name: &str) -> f64 {
        let [l, r] = [&self.errors.left, &self.errors.right].map(|e| e.get(name).unwrap_or(f64::INFINITY));
        (l + r) / 2.0
    }
}

/// Returns the median of each stage's value over the repeats that ran the stage.
fn medians(repeats: &[Repeat], of: fn(&Repeat) -> &BTreeMap<String, f64>) -> BTreeMap<String, f64> {
    let median = |stage: &String| median_of(repeats.iter().filter_map(|r| of(r).get(stage).copied()).collect());
    repeats.iter().flat_map(|r| of(r).keys()).map(|stage| (stage.clone(), median(stage))).collect()
}

/// A setting with its results.
#[derive(Clone, Debug, Serialize)]
pub struct SettingRow {
    #[serde(flatten)]
    pub quality: Quality,
    #[serde(flatten)]
    pub measured: Measured,
    /// True if no other setting is both faster and has a lower [`ERROR`] (mean of both eyes).
    pub on_front: bool,
}

impl SettingRow {
    pub fn new(quality: Quality, measured: Measured) -> Self {
        Self { quality, measured, on_front: false }
    }

    pub fn rung(&self) -> Rung {
        let Measured { time_ms, stage_ms, rays, .. } = &self.measured;
        let [flip, flicker, relmse] = ["flip", FLICKER, "relmse"].map(|name| Some(self.measured.error(name)));
        let (quality, error) = (self.quality, self.measured.error(ERROR));
        let (stage_ms, rays) = (stage_ms.clone(), rays.clone());
        Rung { time_ms: *time_ms, error, flip, flicker, relmse, is_estimated: false, quality, stage_ms, rays }
    }
}

pub(super) fn points(rows: &[&SettingRow], error: &str) -> Vec<(f64, f64)> {
    rows.iter().map(|r| (r.measured.time_ms, r.measured.error(error))).collect()
}

/// Sets [`SettingRow::on_front`] of the rows on the Pareto front of time and [`ERROR`].
pub fn mark_front(rows: &mut [SettingRow]) {
    for i in front(&points(&rows.iter().collect::<Vec<_>>(), ERROR)) {
        rows[i].on_front = true;
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use diptych::image::{Extent, RgbImage};
    use diptych::metrics::Pair;
    use diptych::metrics::rings::Viewing;
    use diptych::quality::{Denoiser, Filter, FrameQuality};

    /// Makes a row whose repeats have these values of RMSE in the left eye and twice these in the right eye.
    pub fn row(denoiser: &str, spp: u32, time_ms: f64, rmse: &[f64]) -> SettingRow {
        let filter = Denoiser::from_name(denoiser).unwrap().map(|denoiser| Filter::new(denoiser, 1));
        let quality = Quality { spp: spp.into(), filter, ..Quality::default() };
        let black = RgbImage::filled(Extent::new(12, 12), [0.0; 3]);
        let viewing = Viewing { gaze: [0.5; 2], yfov_deg: 70.0 };
        let flat = |v: f64| {
            let pair = Pair::new(&black, &RgbImage::filled(black.extent, [v as f32; 3]), 0.0).unwrap();
            SeenErrors::new(&pair, &viewing)
        };
        let repeat = |v: &f64| Repeat {
            stage_ms: [("atrous".to_owned(), time_ms / 4.0)].into(),
            rays: BTreeMap::new(),
            errors: Stereo { left: flat(*v), right: flat(2.0 * v) },
            line: FrameLine { makespan_ms: time_ms, quality: FrameQuality::from(&quality), ..FrameLine::default() },
        };
        let repeats: Vec<Repeat> = rmse.iter().map(repeat).collect();
        let black = || Pair::new(&black, &black, 0.0).unwrap();
        let change = black().change_at_rest(&black()).unwrap();
        SettingRow::new(quality, Measured::of(&repeats, Stereo { left: change, right: change }))
    }

    #[test]
    fn front_keeps_only_undominated_rows() {
        let mut rows = vec![
            row("none", 1, 1.0, &[0.4]),
            row("none", 2, 2.0, &[0.3]),
            row("svgf", 1, 1.5, &[0.2]),
            row("svgf", 2, 3.0, &[0.1]),
        ];
        mark_front(&mut rows);
        assert_eq!(rows.iter().map(|r| r.on_front).collect::<Vec<_>>(), [true, false, true, true]);
    }
}
