//! Measures times and errors over a grid of settings: rows, CSV, Pareto fronts of time against error, and the quality
//! ladder.

mod ladder;
mod regret;
mod slopes;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use ladder::{ladder_svg, ladder_table};
pub use regret::{Regret, regret_table, regrets};
pub use slopes::{Slope, log_slope, slopes};

use super::csv::{Csv, number};
use super::frames::FrameLine;
use super::plot::{Axis, Chart, Series, line_chart_svg};
use super::{ReportError, Table, median_of, once};
use crate::accumulation::Noise;
use crate::control::{Rung, front};
use crate::exec::{FrameReport, Stereo};
use crate::metrics;
use crate::metrics::rings::Viewing;
use crate::metrics::temporal::{Change, TemporalError};
use crate::quality::{Denoiser, FrameQuality, Quality};

/// Metrics that tables show, in this order. Files have the remaining ones after them.
const SHOWN: [&str; 10] =
    ["rmse", "relmse", "psnr", "ssim", "flip", FLICKER, ERROR, "flip_foveated", "flip_acuity", "mean_ratio"];

/// Names of two metrics: the flicker between frames, and FLIP + flicker, by which fronts and ladders are made
/// ([`crate::control::Measure::FlipFlicker`]).
const FLICKER: &str = "flicker";
pub const ERROR: &str = "flip_flicker";

/// A relMSE below this many times the reference's own cannot be distinguished from it.
const NOISE_MARGIN: f64 = 4.0;

/// An eye's errors by name, with the names of [`SeenErrors`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Errors(serde_json::Map<String, serde_json::Value>);

impl Errors {
    /// Returns the means over repeats. A value that is undefined in one repeat is undefined in the mean.
    pub fn mean_of(comparisons: &[impl Serialize]) -> Self {
        let all: Vec<serde_json::Value> = comparisons.iter().filter_map(|c| serde_json::to_value(c).ok()).collect();
        let names = all.first().and_then(|v| v.as_object()).into_iter().flat_map(|v| v.keys());
        let mean = |name: &String| -> Option<f64> {
            let values: Option<Vec<f64>> = all.iter().map(|v| v.get(name)?.as_f64()).collect();
            values.map(|v| v.iter().sum::<f64>() / v.len() as f64)
        };
        Self(names.map(|name| (name.clone(), mean(name).into())).collect())
    }

    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name)?.as_f64()
    }

    /// Adds the flicker between frames, and its sum with FLIP, which is undefined if either is.
    fn with_flicker(mut self, flicker: Option<f64>) -> Self {
        let sum = self.get("flip").zip(flicker).map(|(flip, flicker)| flip + flicker);
        for (name, value) in [(FLICKER, flicker), (ERROR, sum)] {
            self.0.insert(name.to_owned(), value.into());
        }
        self
    }

    /// Returns the names of the errors, those of [`SHOWN`] first.
    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.0.keys().map(String::as_str).collect();
        names.sort_by_key(|n| SHOWN.iter().position(|s| s == n).unwrap_or(SHOWN.len()));
        names
    }
}

/// One measured frame of a setting.
#[derive(Clone, Debug)]
pub struct Repeat {
    /// Busy time by stage, summed over views and devices.
    pub stage_ms: BTreeMap<String, f64>,
    pub errors: Stereo<SeenErrors>,
    /// Its line in `frames.csv`.
    pub line: FrameLine,
}

/// Errors of an eye, with and without weights by the gaze.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SeenErrors {
    #[serde(flatten)]
    pub all: metrics::Errors,
    /// The result of [`metrics::Pair::foveated_flip`].
    pub flip_foveated: f64,
    /// The result of [`metrics::Pair::acuity_flip`].
    pub flip_acuity: f64,
}

impl SeenErrors {
    pub fn new(pair: &metrics::Pair, viewing: &Viewing) -> Self {
        Self { all: pair.errors(), flip_foveated: pair.foveated_flip(viewing), flip_acuity: pair.acuity_flip(viewing) }
    }
}

impl Repeat {
    pub fn new(frame: &FrameReport, errors: Stereo<SeenErrors>, line: FrameLine) -> Self {
        Self { stage_ms: frame.stage_ms(), errors, line }
    }
}

/// Results of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Median, minimum and maximum of the repeats' makespans.
    pub time_ms: f64,
    pub time_ms_min: f64,
    pub time_ms_max: f64,
    /// Medians of the busy times.
    pub stage_ms: BTreeMap<String, f64>,
    pub errors: Stereo<Errors>,
    /// relMSE of each repeat.
    pub relmse_repeats: Stereo<Vec<f64>>,
    /// Line of each repeat in `frames.csv`.
    pub frames: Vec<FrameLine>,
}

impl Measured {
    /// Combines the frames of a setting. `changes` holds the difference between consecutive frames of each eye, with
    /// the camera at rest.
    pub fn of(repeats: &[Repeat], changes: Stereo<Change>) -> Self {
        let times_ms: Vec<f64> = repeats.iter().map(|r| r.line.makespan_ms).collect();
        let stages = repeats.iter().flat_map(|r| r.stage_ms.keys());
        let stage_ms =
            |stage: &String| median_of(repeats.iter().filter_map(|r| r.stage_ms.get(stage).copied()).collect());
        let eye = |of: fn(&Repeat) -> &SeenErrors| repeats.iter().map(|r| *of(r)).collect::<Vec<_>>();
        let found = Stereo { left: eye(|r| &r.errors.left), right: eye(|r| &r.errors.right) };
        let relmse = |c: &[SeenErrors]| c.iter().map(|c| c.all.relmse).collect();
        Self {
            time_ms_min: times_ms.iter().copied().fold(f64::INFINITY, f64::min),
            time_ms_max: times_ms.iter().copied().fold(0.0, f64::max),
            time_ms: median_of(times_ms),
            stage_ms: stages.map(|stage| (stage.clone(), stage_ms(stage))).collect(),
            errors: Stereo {
                left: Errors::mean_of(&found.left).with_flicker(TemporalError::from(changes.left).flicker),
                right: Errors::mean_of(&found.right).with_flicker(TemporalError::from(changes.right).flicker),
            },
            relmse_repeats: Stereo { left: relmse(&found.left), right: relmse(&found.right) },
            frames: repeats.iter().map(|r| r.line.clone()).collect(),
        }
    }

    /// Returns the mean of both eyes; infinite if it is undefined in one.
    pub fn error(&self, name: &str) -> f64 {
        let [l, r] = [&self.errors.left, &self.errors.right].map(|e| e.get(name).unwrap_or(f64::INFINITY));
        (l + r) / 2.0
    }
}

/// A setting with its results.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    #[serde(flatten)]
    pub quality: Quality,
    #[serde(flatten)]
    pub measured: Measured,
    /// True if no other setting is both faster and better by [`ERROR`], as a mean of both eyes.
    pub on_front: bool,
}

impl Row {
    pub fn new(quality: Quality, measured: Measured) -> Self {
        Self { quality, measured, on_front: false }
    }

    pub fn rung(&self) -> Rung {
        let Measured { time_ms, stage_ms, .. } = &self.measured;
        let [flip, flicker, relmse] = ["flip", FLICKER, "relmse"].map(|name| Some(self.measured.error(name)));
        let (quality, error, stage_ms) = (self.quality, self.measured.error(ERROR), stage_ms.clone());
        Rung { time_ms: *time_ms, error, flip, flicker, relmse, is_estimated: false, quality, stage_ms }
    }
}

fn points(rows: &[&Row], error: &str) -> Vec<(f64, f64)> {
    rows.iter().map(|r| (r.measured.time_ms, r.measured.error(error))).collect()
}

/// Marks the rows of the Pareto front.
pub fn mark_front(rows: &mut [Row]) {
    for i in front(&points(&rows.iter().collect::<Vec<_>>(), ERROR)) {
        rows[i].on_front = true;
    }
}

/// Describes the exposure at which the rows' errors were measured.
pub fn exposure_note(exposure_ev: f64) -> String {
    format!("PSNR, SSIM, FLIP and flicker are of pictures tonemapped at {exposure_ev} EV, the shot's exposure.")
}

/// Caption that names the error of fronts and ladders.
pub const ERROR_NOTE: &str = "Fronts and ladders go by flip_flicker: the mean FLIP of the frames on which the moving \
    camera arrives and rests, each with the history of those before it, plus their flicker, by how much pixels change \
    from one of them to the next.";

/// Names and values of the columns that all rows of a table share.
pub type Shared = Vec<(&'static str, String)>;

/// Returns a line per setting and eye. Undefined values are empty.
pub fn csv(shared: &Shared, rows: &[Row]) -> Csv {
    let metrics = rows.first().map_or(Vec::new(), |r| r.measured.errors.left.names());
    let mut columns: Vec<&str> = shared.iter().map(|(name, _)| *name).collect();
    columns.extend(COLUMNS);
    columns.extend(["time_ms", "time_ms_min", "time_ms_max", "on_front", "eye"]);
    columns.extend(&metrics);
    let mut lines = Vec::new();
    for Row { quality, measured, on_front } in rows {
        let Measured { time_ms, time_ms_min, time_ms_max, errors, .. } = measured;
        for (eye, errors) in [("left", &errors.left), ("right", &errors.right)] {
            let mut line: Vec<String> = shared.iter().map(|(_, value)| value.clone()).collect();
            line.extend(cells_of(quality));
            line.extend([time_ms, time_ms_min, time_ms_max].map(|ms| format!("{ms:.4}")));
            line.extend([on_front.to_string(), eye.to_owned()]);
            line.extend(metrics.iter().map(|name| number(errors.get(name), 9)));
            lines.push(line);
        }
    }
    Csv { columns: columns.into_iter().map(str::to_owned).collect(), lines }
}

/// Returns a line per timed frame, with the settings that [`FrameLine`] lacks.
pub fn frames(rows: &[Row]) -> Csv {
    let lines = || rows.iter().flat_map(|row| row.measured.frames.iter().map(move |line| (row, line)));
    let setting = |(row, _): (&Row, &FrameLine)| {
        let [denoiser, _, _, foveation, ..] = cells_of(&row.quality);
        vec![denoiser, foveation]
    };
    let columns = ["denoiser", "foveation"].map(str::to_owned).into();
    let settings = Csv { columns, lines: lines().map(setting).collect() };
    settings.beside(FrameLine::csv(&lines().map(|(_, line)| line.clone()).collect::<Vec<_>>()))
}

/// Columns of a quality.
const COLUMNS: [&str; 6] = ["denoiser", "iterations", "bounces", "foveation", "scale", "spp"];

/// Returns the cells of a quality, with layers in the command line's notation.
fn cells_of(quality: &Quality) -> [String; 6] {
    let FrameQuality { spp, bounces, iterations, scale, fovea } = quality.into();
    let foveation = match (fovea, &quality.polar) {
        (Some(_), _) => "layers",
        (None, Some(space)) => space.name(),
        (None, None) => "none",
    };
    let [iterations, bounces, spp] = [iterations, bounces, spp].map(|n| n.to_string());
    [Denoiser::name_of(quality.denoiser).to_owned(), iterations, bounces, foveation.to_owned(), scale.to_string(), spp]
}

/// Plots time against both eyes' relMSE, with the front of each denoiser and, below, the noise of the reference.
///
/// # Errors
/// [`ReportError`] if there is nothing to draw.
pub fn svg(title: String, rows: &[Row], noise: Option<&Stereo<Noise>>) -> Result<String, ReportError> {
    let mut series = fronts(rows, "relmse");
    if let Some(noise) = noise {
        let level = (noise.left.relmse + noise.right.relmse) / 2.0;
        let times_ms = rows.iter().map(|r| r.measured.time_ms);
        let ends = times_ms.fold([f64::INFINITY, 0.0], |[a, b], t| [a.min(t), b.max(t)]);
        let points = ends.map(|t| (t, level)).into();
        series.push(Series { name: "noise of the reference".into(), points, band: None, guide: true });
    }
    time_chart(title, "relMSE, mean of both eyes", &series)
}

fn time_chart(title: String, error: &str, series: &[Series]) -> Result<String, ReportError> {
    let (x, y) = ("time of a frame, ms".into(), error.into());
    line_chart_svg(&Chart { title, x: Axis { label: x, log: true }, y: Axis { label: y, log: true } }, series)
}

/// Returns the Pareto front of each denoiser's settings.
fn fronts(rows: &[Row], error: &str) -> Vec<Series> {
    let denoisers = once(rows.iter().map(|r| r.quality.denoiser));
    let series = |denoiser: &Option<Denoiser>| {
        let points = points(&rows.iter().filter(|r| r.quality.denoiser == *denoiser).collect::<Vec<_>>(), error);
        let points = front(&points).into_iter().map(|i| points[i]).collect();
        Series { name: Denoiser::name_of(*denoiser).to_owned(), points, band: None, guide: false }
    };
    denoisers.iter().map(series).collect()
}

/// Returns a line per setting and eye.
pub fn table(rows: &[Row], noise: Option<&Stereo<Noise>>) -> Table {
    let metrics: Vec<&str> =
        SHOWN.into_iter().filter(|m| rows.iter().any(|r| r.measured.errors.left.0.contains_key(*m))).collect();
    let mut headers = COLUMNS.to_vec();
    headers.extend(["ms", "eye"]);
    headers.extend(&metrics);
    headers.push("note");
    let mut lines = Vec::new();
    for Row { quality, measured, on_front } in rows {
        let of = |n: fn(&Stereo<Noise>) -> f64| noise.map_or(0.0, n);
        let Stereo { left, right } = &measured.errors;
        for (eye, errors, noise) in [("left", left, of(|n| n.left.relmse)), ("right", right, of(|n| n.right.relmse))] {
            let mut line = cells_of(quality).to_vec();
            line.extend([format!("{:.1}", measured.time_ms), eye.to_owned()]);
            line.extend(metrics.iter().map(|m| errors.get(m).map_or("-".into(), |v| format!("{v:.4}"))));
            let is_lost = errors.get("relmse").is_some_and(|e| e < NOISE_MARGIN * noise);
            let front = if *on_front { "front" } else { "" };
            line.push(if is_lost { "within the reference's noise".into() } else { front.to_owned() });
            lines.push(line);
        }
    }
    Table { headers, rows: lines }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Extent, RgbImage};
    use crate::metrics::Pair;

    /// Makes a setting whose repeats have these RMSE in the left eye and twice that in the right.
    pub(super) fn row(denoiser: &str, spp: u32, time_ms: f64, rmse: &[f64]) -> Row {
        let denoiser = Denoiser::from_name(denoiser).unwrap();
        let quality = Quality { spp, bounces: 6, denoiser, iterations: [0; 3], fovea: None, polar: None, scale: 1.0 };
        let black = RgbImage::filled(Extent::new(12, 12), [0.0; 3]);
        let viewing = Viewing { gaze: [0.5; 2], yfov_deg: 70.0 };
        let flat = |v: f64| {
            let pair = Pair::new(&black, &RgbImage::filled(black.extent, [v as f32; 3]), 0.0).unwrap();
            SeenErrors::new(&pair, &viewing)
        };
        let repeat = |v: &f64| Repeat {
            stage_ms: [("atrous".to_owned(), time_ms / 4.0)].into(),
            errors: Stereo { left: flat(*v), right: flat(2.0 * v) },
            line: FrameLine { makespan_ms: time_ms, quality: FrameQuality::from(&quality), ..FrameLine::default() },
        };
        let repeats: Vec<Repeat> = rmse.iter().map(repeat).collect();
        let black = || Pair::new(&black, &black, 0.0).unwrap();
        let change = black().change_at_rest(&black()).unwrap();
        Row::new(quality, Measured::of(&repeats, Stereo { left: change, right: change }))
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let mut rows = vec![
            row("none", 1, 1.0, &[0.4]),
            row("none", 2, 2.0, &[0.3]),
            row("svgf", 1, 1.5, &[0.2]),
            row("svgf", 2, 3.0, &[0.1]),
        ];
        mark_front(&mut rows);
        assert_eq!(rows.iter().map(|r| r.on_front).collect::<Vec<_>>(), [true, false, true, true]);
    }

    #[test]
    fn a_csv_has_a_column_per_metric_and_a_line_per_eye() {
        let rows = [row("none", 4, 12.5, &[0.25, 0.75])];
        let table = csv(&vec![("devices", "2".into())], &rows);
        let begin = "devices,denoiser,iterations,bounces,foveation,scale,spp,time_ms,";
        assert!(table.columns.join(",").starts_with(begin), "{:?}", table.columns);
        assert_eq!(table.lines[0][..7], ["2", "none", "0", "6", "none", "1", "4"]);
        let found = ["time_ms", "on_front", "eye", "rmse"];
        assert_eq!(found.map(|name| table.value(0, name)), ["12.5000", "false", "left", "0.500000000"]);
        assert_eq!(found.map(|name| table.value(1, name)), ["12.5000", "false", "right", "1.000000000"]);
        assert!(table.lines.iter().all(|line| line.len() == table.columns.len()), "{table:?}");
        // The mean ratio to a black reference is undefined.
        assert_eq!(table.value(0, "mean_ratio"), "");

        let frames = frames(&rows);
        assert_eq!(frames.lines.len(), 2);
        let found = ["denoiser", "foveation", "spp", "makespan_ms"];
        assert_eq!(found.map(|name| frames.value(1, name)), ["none", "none", "4", "12.5000"]);
    }

    #[test]
    fn charts_leave_out_what_is_on_no_front() {
        let rows = [row("none", 1, 1.0, &[0.4]), row("none", 2, 2.0, &[0.5]), row("none", 4, 3.0, &[0.3])];
        let svg = svg("t".into(), &rows, None).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
    }

    #[test]
    fn errors_within_the_noise_are_said_to_be() {
        let floor = Noise { rmse: 100.0, relmse: 10.0 };
        let noise = Stereo { left: floor, right: floor };
        let text = table(&[row("none", 4, 12.5, &[0.5])], Some(&noise)).text();
        let noted: Vec<bool> = text.lines().skip(2).map(|l| l.contains("noise")).collect();
        assert_eq!(noted, [true, false], "{text}");
    }
}
