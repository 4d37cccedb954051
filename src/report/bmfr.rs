//! Compares two ways to keep the fit of Xu, Tong & Xu, "Real-time Blockwise Multi-order Feature Regression", well
//! conditioned: omit linearly dependent features, or add noise to all. Compares both with `svgf`, and prints the
//! authors' numbers beside ours.

use serde::Serialize;

use super::Table;
use super::bench::Measured;
use super::csv::{Column, Csv, number};
use super::study::{cell, table};
use crate::quality::Denoiser;

/// Denoisers to compare.
pub const DENOISERS: [Denoiser; 3] = [Denoiser::SVGF, Denoiser::BMFR, Denoiser::BMFR_NOISE];

const PATHS: [&str; 2] = ["path_trace", "hole_fill"];
/// Stages of the fit, or their equivalents in `svgf`.
const FILTERS: [&str; 3] = ["fit", "variance", "svgf"];

/// Results of a denoiser on a scene.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `measured` or `cited`.
    pub source: &'static str,
    pub scene: String,
    pub denoiser: &'static str,
    /// Median, minimum and maximum of the frames' makespans.
    pub time_ms: Option<[f64; 3]>,
    pub frames_per_s: f64,
    /// Times of path tracing and of the filter in ms, for both eyes and summed over devices.
    pub path_ms: Option<f64>,
    pub filter_ms: Option<f64>,
    /// Time of the filter as a fraction of the devices' time in all stages.
    pub filter_share: Option<f64>,
    /// Means of both eyes.
    pub flip: Option<f64>,
    pub flicker: Option<f64>,
}

impl Row {
    pub fn measured(scene: String, denoiser: Denoiser, of: &Measured) -> Self {
        let sum = |is_of: &dyn Fn(&str) -> bool| {
            of.stage_ms.iter().filter(|(stage, _)| is_of(stage)).map(|(_, ms)| ms).sum::<f64>()
        };
        let filter_ms = sum(&|stage| FILTERS.contains(&stage));
        Self {
            source: "measured",
            scene,
            denoiser: Denoiser::name_of(Some(denoiser)),
            time_ms: Some([of.time_ms, of.time_ms_min, of.time_ms_max]),
            frames_per_s: 1e3 / of.time_ms,
            path_ms: Some(sum(&|stage| PATHS.contains(&stage))),
            filter_ms: Some(filter_ms),
            filter_share: Some(filter_ms / sum(&|_| true)),
            flip: Some(of.error("flip")),
            flicker: Some(of.error("flicker")),
        }
    }

    fn cited(denoiser: Denoiser, frames_per_s: f64) -> Self {
        Self {
            source: "cited",
            scene: "Falcor's default scene".to_owned(),
            denoiser: Denoiser::name_of(Some(denoiser)),
            time_ms: None,
            frames_per_s,
            path_ms: None,
            filter_ms: None,
            filter_share: None,
            flip: None,
            flicker: None,
        }
    }
}

/// Returns the authors' measurements.
pub fn cited() -> [Row; 2] {
    let (path_ms, filter_ms, filter_share) = (Some(7.08), Some(6.42), Some(0.427));
    [
        Row::cited(Denoiser::BMFR, 78.0),
        Row { path_ms, filter_ms, filter_share, ..Row::cited(Denoiser::BMFR_NOISE, 71.0) },
    ]
}

const SHOWN: [Column<Row>; 10] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("denoiser", |r| r.denoiser.to_owned()),
    ("frame ms", |r| cell(r.time_ms.map(|ms| ms[0]), 1)),
    ("least..most", |r| r.time_ms.map_or("-".to_owned(), |[_, least, most]| format!("{least:.1}..{most:.1}"))),
    ("frames/s", |r| format!("{:.1}", r.frames_per_s)),
    ("path ms", |r| cell(r.path_ms, 2)),
    ("filter ms, share", |r| {
        let share = r.filter_share.map_or(String::new(), |share| format!(", {:.1} %", 100.0 * share));
        cell(r.filter_ms, 2) + &share
    }),
    ("FLIP", |r| cell(r.flip, 4)),
    ("flicker", |r| cell(r.flicker, 5)),
];

/// The caption of [`bmfr_table`].
pub const NOTE: &str = "1 spp, 6 bounces; the camera follows its path and stops. The denoisers take turns frame by \
    frame. frame ms: median, least and most. path: path tracing and hole filling. filter: the regression, or variance \
    and iterations of svgf; median of the sum over all devices, and its fraction of all stages. FLIP against the \
    reference and flicker between frames are means of both eyes. bmfr drops dependent features; bmfr_noise instead \
    adds noise to all features. Cited: Xu, Tong & Xu on a laptop's RTX 2070, one eye; their stage time is that of the \
    regression with noise.";

/// Returns a table with a line per scene and denoiser.
pub fn bmfr_table(rows: &[Row]) -> Table {
    table(&SHOWN, rows)
}

const CSV: [Column<Row>; 12] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("denoiser", |r| r.denoiser.to_owned()),
    ("time_ms", |r| number(r.time_ms.map(|ms| ms[0]), 4)),
    ("time_ms_min", |r| number(r.time_ms.map(|ms| ms[1]), 4)),
    ("time_ms_max", |r| number(r.time_ms.map(|ms| ms[2]), 4)),
    ("frames_per_s", |r| format!("{:.4}", r.frames_per_s)),
    ("path_ms", |r| number(r.path_ms, 4)),
    ("filter_ms", |r| number(r.filter_ms, 4)),
    ("filter_share", |r| number(r.filter_share, 5)),
    ("flip", |r| number(r.flip, 6)),
    ("flicker", |r| number(r.flicker, 6)),
];

/// Returns the contents of `bmfr.csv`.
pub fn bmfr_csv(rows: &[Row]) -> Csv {
    Csv::new(&CSV, rows)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::exec::Stereo;
    use crate::report::bench::Errors;

    #[test]
    fn a_filter_is_the_fit_or_what_stands_in_its_place() {
        let stages = |stages: &[(&str, f64)]| -> BTreeMap<String, f64> {
            stages.iter().map(|(name, ms)| ((*name).to_owned(), *ms)).collect()
        };
        let eye = |flip: f64| Errors::mean_of(&[serde_json::json!({ "flip": flip, "flicker": 2.0 * flip })]);
        let measured = |stage_ms| Measured {
            time_ms: 20.0,
            time_ms_min: 19.0,
            time_ms_max: 22.0,
            stage_ms,
            errors: Stereo { left: eye(0.1), right: eye(0.2) },
            relmse_repeats: Stereo { left: Vec::new(), right: Vec::new() },
            frames: Vec::new(),
        };
        let paths = [("path_trace", 6.0), ("hole_fill", 2.0), ("accumulate", 4.0)];
        let fitted = measured(stages(&[&paths[..], &[("fit", 4.0)]].concat()));
        let svgf = measured(stages(&[&paths[..], &[("variance", 1.0), ("svgf", 3.0)]].concat()));
        for (denoiser, of) in [(Denoiser::BMFR, &fitted), (Denoiser::SVGF, &svgf)] {
            let rows = [Row::measured("builtin:cornell".to_owned(), denoiser, of)];
            let csv = bmfr_csv(&rows);
            let found = ["denoiser", "frames_per_s", "path_ms", "filter_ms", "filter_share", "flip", "flicker"];
            let found = found.map(|name| csv.value(0, name));
            let expected = ["50.0000", "8.0000", "4.0000", "0.25000", "0.150000", "0.300000"];
            assert_eq!(found, [&[Denoiser::name_of(Some(denoiser))], &expected[..]].concat()[..]);
        }
        let shown = bmfr_table(&cited()).rows;
        assert_eq!(shown[0][3..8], ["-", "-", "78.0", "-", "-"]);
        assert_eq!(shown[1][3..8], ["-", "-", "71.0", "7.08", "6.42, 42.7 %"]);
    }
}
