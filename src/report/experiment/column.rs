//! Columns of numbers, and how they are computed from measurements.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::camera::Camera;
use super::times::{FrameTimes, TRANSFERS, median_over, speedup_by_frame, stage_ms};
use crate::report::bench::Measured;
use crate::report::frames::FrameLine;
use crate::report::median_of;
use crate::report::study::{deviation, mean, quartiles};

/// A column of numbers. Exactly one of `measure`, `stages`, `fraction`, `speedup` and `cited` must be given.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Column {
    pub(super) name: String,
    pub(super) decimals: usize,
    /// One of [`measures`].
    pub measure: Option<String>,
    /// How an error is summarised over instants and eyes.
    #[serde(default)]
    pub(super) statistic: Statistic,
    /// The frames to measure, for [`Camera::Late`].
    #[serde(default)]
    pub(super) of: LateImage,
    /// Stages whose busy times are added up. Cells are empty if none of the stages ran.
    pub(super) stages: Option<Vec<String>>,
    /// True to average the time of `stages` over the devices that ran any of them, instead of adding it up.
    #[serde(default)]
    pub(super) mean_of_devices: bool,
    /// Stages whose fraction of the busy time is shown: their total busy time divided by that of all stages.
    pub(super) fraction: Option<Vec<String>>,
    /// Column that speedups are computed from: its value for the first arrangement is divided by its value for the
    /// row's arrangement.
    pub(super) speedup: Option<String>,
    /// Column whose published value is shown, for the row's scene, resolution, camera and arrangement.
    pub(super) cited: Option<String>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Statistic {
    #[default]
    Mean,
    /// Maximum over instants and eyes.
    Maximum,
    /// Standard deviation over instants, with divisor n − 1, of the mean of both eyes.
    Deviation,
}

/// Frames that are compared with a frame rendered at the pose of display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum LateImage {
    /// The late frame, as it was rendered.
    #[default]
    Uncorrected,
    /// The late frame, reprojected to the pose of display.
    Corrected,
    /// Another frame rendered at the pose of display, with other random numbers.
    Repeated,
}

/// Errors against the reference, which are means of both eyes unless [`Column::statistic`] says otherwise.
const ERRORS: [&str; 10] =
    ["rmse", "rmse_percent", "relmse", "psnr", "ssim", "flip", "flip_acuity", "flip_foveated", "flicker", "mean_ratio"];

/// Other measures.
const OTHERS: [&str; 18] = [
    "frames",
    "total_s",
    "frame_speedup",
    "primary_busy",
    "others_busy",
    "time_ms",
    "time_ms_min",
    "time_ms_max",
    "time_ms_iqr",
    "frames_per_s",
    "rays",
    "instants",
    "exposure_ev",
    "paths_left",
    "paths_right",
    "floor",
    "sigma",
    "dispatched",
];

/// Measures of the fovea under a moving gaze, for which additional frames are rendered.
pub const FOVEA: [&str; 2] = ["fovea_flip", "fovea_flicker"];

/// Measures of rings around the gaze: SSIM against the reference in the innermost ring, and in the outermost ring whose
/// SSIM is defined; then SSIM against the first arrangement in the same two rings.
pub const RINGS: [&str; 4] = ["ssim_gaze", "ssim_edge", "ssim_basic_gaze", "ssim_basic_edge"];

/// Measures of [`Camera::Late`]: the latency in frames and in milliseconds, and the mean rotation (degrees) and
/// translation (millimetres) of the left eye during the latency.
pub const LATENCY: [&str; 4] = ["latency_frames", "latency_ms", "turned_deg", "moved_mm"];

/// Returns the valid values of [`Column::measure`].
fn measures() -> Vec<&'static str> {
    [&OTHERS[..], &ERRORS, &FOVEA, &RINGS, &LATENCY].concat()
}

/// Measures of an arrangement other than its times and errors, by name.
pub type OtherMeasures = BTreeMap<&'static str, f64>;

/// Measurements of an arrangement.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Times of each frame, and its line in `frames.csv`. Simulated frames have no line.
    pub times: Vec<FrameTimes>,
    pub lines: Vec<FrameLine>,
    /// Errors at each instant.
    pub instants: Vec<Measured>,
    /// Errors at each instant of the reprojected frame, and of another frame that was rendered at the pose of display;
    /// both are empty unless the camera is [`Camera::Late`].
    pub corrected: Vec<Measured>,
    pub repeated: Vec<Measured>,
    pub others: OtherMeasures,
}

impl Column {
    /// Checks the column of an experiment with these columns and cameras.
    ///
    /// # Errors
    /// A message that names the invalid key.
    pub(super) fn check(&self, columns: &[Self], cameras: &[Camera]) -> Result<(), String> {
        let find = |of: &str| columns.iter().find(|column| column.name == of);
        let Self { name, decimals, measure, stages, mean_of_devices, fraction, speedup, cited, statistic, of } = self;
        let sources = [measure.is_some(), stages.is_some(), fraction.is_some(), speedup.is_some(), cited.is_some()];
        if sources.into_iter().filter(|is_given| *is_given).count() != 1 {
            return Err(format!("columns: {name}: give one of measure, stages, fraction, speedup and cited"));
        }
        if *decimals > 12 {
            return Err(format!("columns: {name}: decimals: {decimals} is more than 12"));
        }
        let known = measures();
        if let Some(unknown) = measure.as_deref().filter(|measure| !known.contains(measure)) {
            let known = known.join(", ");
            return Err(format!("columns: {name}: measure: there is no '{unknown}': choose one of {known}"));
        }
        let is_error = measure.as_deref().is_some_and(|measure| ERRORS.contains(&measure));
        if *statistic != Statistic::Mean && !is_error {
            return Err(format!("columns: {name}: statistic needs an error as measure"));
        }
        if *of != LateImage::Uncorrected && !(is_error && cameras.contains(&Camera::Late)) {
            return Err(format!("columns: {name}: of needs an error as measure, and the camera late"));
        }
        if *mean_of_devices && stages.is_none() {
            return Err(format!("columns: {name}: mean_of_devices needs stages"));
        }
        if is_error && cameras.contains(&Camera::Following) {
            return Err(format!("columns: {name}: measure: the camera following has no reference"));
        }
        if let Some(unknown) = cited.as_deref().filter(|of| find(of).is_none()) {
            return Err(format!("columns: {name}: cited: there is no column '{unknown}'"));
        }
        match speedup.as_deref().filter(|of| find(of).is_none_or(|column| column.speedup.is_some())) {
            Some(unknown) => Err(format!("columns: {name}: speedup: there is no measured column '{unknown}'")),
            None => Ok(()),
        }
    }

    /// Returns the column's value for an arrangement, where `first` is what was found for the first one; `None` for
    /// speedups and published numbers, which [`Experiment::measured`](super::Experiment::measured) adds.
    pub(super) fn value(&self, found: &Found, first: &Found) -> Option<f64> {
        if let Some(stages) = self.stages.as_ref().filter(|_| self.mean_of_devices) {
            return median_over(&found.times, |frame| frame.mean_ms(stages));
        }
        if let Some(stages) = self.stages.as_ref().or(self.fraction.as_ref()) {
            let all = stage_ms(&found.times);
            let own: Vec<f64> = stages.iter().filter_map(|stage| all.get(stage).copied()).collect();
            let of = |(stage, ms): (&String, &f64)| (!TRANSFERS.contains(&stage.as_str())).then_some(*ms);
            let whole = if self.fraction.is_some() { all.iter().filter_map(of).sum() } else { 1.0 };
            return (!own.is_empty()).then(|| own.iter().sum::<f64>() / whole);
        }
        let measure = self.measure.as_deref()?;
        if ERRORS.contains(&measure) {
            return self.error(measure, found);
        }
        let others = found.others.get(measure).copied();
        if others.is_some() || found.times.is_empty() {
            return others;
        }
        let times_ms: Vec<f64> = found.times.iter().map(|frame| frame.makespan_ms).collect();
        match measure {
            "frames" => Some(times_ms.len() as f64),
            "total_s" => Some(times_ms.iter().sum::<f64>() / 1e3),
            "frame_speedup" => speedup_by_frame(&first.times, &found.times),
            "primary_busy" => median_over(&found.times, |frame| frame.busy()[0]),
            "others_busy" => median_over(&found.times, |frame| frame.busy()[1]),
            "time_ms" => Some(median_of(times_ms)),
            "time_ms_min" => times_ms.into_iter().reduce(f64::min),
            "time_ms_max" => times_ms.into_iter().reduce(f64::max),
            "time_ms_iqr" => Some(quartiles(times_ms)).map(|[lower, _, upper]| upper - lower),
            "frames_per_s" => Some(1e3 / median_of(times_ms)),
            "rays" => Some(mean(&found.lines.iter().map(|line| line.rays as f64).collect::<Vec<_>>())),
            "instants" => Some(found.instants.len() as f64),
            _ => None,
        }
    }

    /// Returns the statistic of an error. It has no value if the error is undefined anywhere.
    fn error(&self, name: &str, found: &Found) -> Option<f64> {
        let instants = match self.of {
            LateImage::Uncorrected => &found.instants,
            LateImage::Corrected => &found.corrected,
            LateImage::Repeated => &found.repeated,
        };
        let of_eyes = |at: &Measured| {
            let eyes = |name| Some([at.errors.left.get(name)?, at.errors.right.get(name)?]);
            if name != "rmse_percent" {
                return eyes(name);
            }
            // The peak value of the PSNR is the display range.
            let [left, right] = eyes("psnr")?;
            Some([100.0 * 10f64.powf(-(left + right) / 2.0 / 20.0); 2])
        };
        let all = instants.iter().map(of_eyes).collect::<Option<Vec<[f64; 2]>>>().filter(|all| !all.is_empty())?;
        let means: Vec<f64> = all.iter().map(|[left, right]| (left + right) / 2.0).collect();
        match self.statistic {
            Statistic::Mean => Some(mean(&means)),
            Statistic::Maximum => all.into_iter().flatten().reduce(f64::max),
            Statistic::Deviation => (means.len() > 1).then(|| deviation(&means)),
        }
    }
}
