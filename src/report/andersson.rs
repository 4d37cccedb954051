//! Reproduces Andersson & Hansson 2020, "Performance Optimizations for Foveated Real-Time Raytracing" (master's thesis,
//! Lund). Compares log-polar images in the thesis's four modes with tracing every pixel of the screen, by rings around
//! the gaze, and prints the authors' numbers beside ours.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Table;
use super::bench::Measured;
use super::csv::{Column, Csv, number, optional};
use super::rings::RingRow;
use super::study::{cell, table};
use crate::image::Extent;
use crate::metrics::rings::Viewing;
use crate::quality::LogPolar;

/// Modes: every pixel of the screen, then those of the thesis.
pub const MODES: [&str; 5] =
    ["basic", LogPolar::PRESETS[0].0, LogPolar::PRESETS[1].0, LogPolar::PRESETS[2].0, LogPolar::PRESETS[3].0];

/// Camera motions to compare.
pub const CAMERAS: [&str; 2] = ["still", "moving"];

/// Number of rings of equal angle from the gaze to the farthest corner: 2.05 degrees each with the gaze in the middle
/// of the screen.
pub const RINGS: usize = 20;

/// Returns the thesis's viewing conditions for a screen of this size (its equation 5.1): the gaze is in the middle, and
/// the diagonal over the distance is the tangent of 60 degrees.
pub fn viewing(screen: Extent) -> Viewing {
    let (width, height) = (f64::from(screen.width), f64::from(screen.height));
    let tan_half = height / width.hypot(height) * LogPolar::DIAGONAL_DEG.to_radians().tan() / 2.0;
    Viewing { gaze: [0.5; 2], yfov_deg: 2.0 * tan_half.atan().to_degrees() }
}

/// Parts of a frame, with the stages in each.
const PARTS: [(&str, &[&str]); 6] = [
    ("gbuffer_ms", &["gbuffer", "motion"]),
    ("reproject_ms", &["reproject"]),
    ("path_ms", &["path_trace", "hole_fill"]),
    ("filter_ms", &["accumulate", "variance", "svgf", "compose"]),
    ("resolve_ms", &["resolve"]),
    ("map_ms", &["polar_blur", "to_screen"]),
];

/// Results of a mode on a scene.
#[derive(Clone, Debug, Default, Serialize)]
pub struct AnderssonRow {
    /// `measured` or `cited`.
    pub source: &'static str,
    pub scene: String,
    /// One of [`CAMERAS`]; none for cited values that do not depend on it.
    pub camera: Option<&'static str>,
    pub mode: &'static str,
    /// Pixels of the left eye's image over those of its screen: all of them, then those that start paths.
    pub dispatched: Option<f64>,
    pub traced: Option<f64>,
    /// Median, minimum and maximum of the frames' makespans.
    pub time_ms: Option<[f64; 3]>,
    /// Speedup over the basic mode.
    pub speedup: Option<f64>,
    /// Time of each part in ms, for both eyes and summed over devices, by column name.
    #[serde(flatten)]
    pub parts_ms: BTreeMap<&'static str, f64>,
    /// Means of both eyes.
    pub flip: Option<f64>,
    pub flip_acuity: Option<f64>,
    pub flip_foveated: Option<f64>,
    /// Flicker with a camera at rest.
    pub flicker: Option<f64>,
    /// SSIM of the ring at the gaze and of the outermost ring with a value.
    pub ssim: [Option<f64>; 2],
    /// The same against the basic mode's frames.
    pub ssim_basic: [Option<f64>; 2],
}

/// Returns the rows of a scene and a camera, in the order of [`MODES`]. Each result comes with the fractions of
/// dispatched and traced pixels and with its rings.
pub fn measured(scene: &str, camera: &'static str, found: &[(Measured, [f64; 2], Vec<RingRow>)]) -> Vec<AnderssonRow> {
    let basic_ms = found.first().map(|(of, ..)| of.time_ms);
    let row = |(mode, (of, [dispatched, traced], rings)): (&'static str, &(Measured, [f64; 2], Vec<RingRow>))| {
        let part = |(name, stages): (&'static str, &[&str])| {
            let own: Vec<f64> = stages.iter().filter_map(|stage| of.stage_ms.get(*stage).copied()).collect();
            (!own.is_empty()).then(|| (name, own.iter().sum()))
        };
        let ends =
            |ssim: fn(&RingRow) -> Option<f64>| [rings.first().and_then(ssim), rings.iter().rev().find_map(ssim)];
        let error = |name: &str| Some(of.error(name)).filter(|error| error.is_finite());
        AnderssonRow {
            source: "measured",
            scene: scene.to_owned(),
            camera: Some(camera),
            mode,
            dispatched: Some(*dispatched),
            traced: Some(*traced),
            time_ms: Some([of.time_ms, of.time_ms_min, of.time_ms_max]),
            speedup: basic_ms.map(|basic| basic / of.time_ms),
            parts_ms: PARTS.into_iter().filter_map(part).collect(),
            flip: error("flip"),
            flip_acuity: error("flip_acuity"),
            flip_foveated: error("flip_foveated"),
            flicker: error("flicker"),
            ssim: ends(|ring| ring.ssim),
            ssim_basic: ends(|ring| ring.ssim_basic),
        }
    };
    MODES.into_iter().zip(found).map(row).collect()
}

/// Table 5.2 (Titan V), with the fractions from table 5.3.
const CITED_MS: [(&str, [Option<f64>; 5]); 4] = [
    ("Sponza", [Some(6.52), Some(10.58), Some(5.62), Some(3.98), None]),
    ("Sponza, antialiased", [None, Some(11.07), Some(5.91), Some(4.21), Some(4.21)]),
    ("Bistro", [Some(8.73), Some(11.33), Some(6.49), Some(4.61), None]),
    ("Bistro, antialiased", [None, Some(11.78), Some(6.79), Some(4.87), Some(4.90)]),
];
const CITED_SHARES: [[f64; 2]; 5] = [[1.0, 1.0], [1.62, 1.54], [0.754, 0.657], [0.483, 0.375], [0.476, 0.377]];

/// Chapter 6: by mode, SSIM close to the gaze and in the periphery. A range, at most 0.02 wide, is replaced by its
/// middle.
const CITED_SSIM: [(&str, Option<&str>, [f64; 4], f64); 3] = [
    ("Bistro", None, [0.98, 0.98, 0.97, 0.97], 0.93),
    ("Bistro, antialiased", Some(CAMERAS[0]), [0.98, 0.98, 1.0, 1.0], 0.935),
    ("Bistro, antialiased", Some(CAMERAS[1]), [0.96; 4], 0.92),
];

/// Returns the authors' results.
pub fn cited() -> Vec<AnderssonRow> {
    let row = |scene: &str, camera, mode: usize| {
        let [dispatched, traced] = CITED_SHARES[mode].map(Some);
        AnderssonRow {
            source: "cited",
            scene: scene.to_owned(),
            camera,
            mode: MODES[mode],
            dispatched,
            traced,
            ..AnderssonRow::default()
        }
    };
    let basic_ms = |times: usize| CITED_MS[times / 2 * 2].1[0];
    let times = CITED_MS.iter().enumerate().flat_map(|(i, (scene, times))| {
        let of = times.iter().enumerate().filter_map(move |(mode, ms)| Some((mode, (*ms)?)));
        of.map(move |(mode, ms)| {
            let speedup = basic_ms(i).map(|basic| basic / ms);
            AnderssonRow { time_ms: Some([ms; 3]), speedup, ..row(scene, None, mode) }
        })
    });
    let ssim = CITED_SSIM.iter().flat_map(|(scene, camera, centre, edge)| {
        let of = centre.iter().enumerate();
        of.map(move |(i, centre)| AnderssonRow { ssim: [Some(*centre), Some(*edge)], ..row(scene, *camera, i + 1) })
    });
    times.chain(ssim).collect()
}

fn percent(share: Option<f64>) -> String {
    cell(share.map(|share| 100.0 * share), 1)
}

fn part(row: &AnderssonRow, part: usize) -> Option<f64> {
    row.parts_ms.get(PARTS[part].0).copied()
}

fn ends(ssim: &[Option<f64>; 2]) -> String {
    ssim.map(|value| cell(value, 3)).join(", ")
}

const SHOWN: [Column<AnderssonRow>; 20] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("camera", |r| r.camera.unwrap_or("-").to_owned()),
    ("mode", |r| r.mode.to_owned()),
    ("dispatched %", |r| percent(r.dispatched)),
    ("traced %", |r| percent(r.traced)),
    ("frame ms", |r| cell(r.time_ms.map(|ms| ms[0]), 2)),
    ("speed-up", |r| cell(r.speedup, 2)),
    ("gbuffer ms", |r| cell(part(r, 0), 2)),
    ("reproject ms", |r| cell(part(r, 1), 2)),
    ("path ms", |r| cell(part(r, 2), 2)),
    ("filter ms", |r| cell(part(r, 3), 2)),
    ("resolve ms", |r| cell(part(r, 4), 2)),
    ("map ms", |r| cell(part(r, 5), 2)),
    ("FLIP", |r| cell(r.flip, 4)),
    ("by acuity", |r| cell(r.flip_acuity, 4)),
    ("foveated", |r| cell(r.flip_foveated, 4)),
    ("flicker", |r| cell(r.flicker, 5)),
    ("SSIM, gaze, edge", |r| ends(&r.ssim)),
    ("to basic", |r| ends(&r.ssim_basic)),
];

/// The caption of [`andersson_table`].
pub const NOTE: &str = "1 spp, 6 bounces, svgf with 5 iterations, diptych's own TAA, no blur, central gaze. The modes \
    take turns frame by frame. basic: every pixel of the screen; fov: log-polar; kernel: log-polar with a kernel; \
    composite: with every pixel around the gaze; composite-kernel: both. dispatched, traced: pixels of the left eye's \
    image, and those that start paths, relative to the screen. frame: median; speed-up: relative to basic. The other \
    times are medians of the sum over all devices and both eyes; the filter includes accumulation and composition. \
    FLIP and SSIM compare with a converged reference of the same instant; the thesis compares with 16 samples per \
    pixel. FLIP is also weighted by the acuity of visual-polar space and by Geisler & Perry's. SSIM is that of the \
    innermost and the outermost ring; 'to basic' compares with the noisy frames of that mode. All values are means of \
    both eyes and all frames. still: the camera does not move; moving: frames at instants along the camera's path, \
    each with history from the path before it. Cited: Andersson & Hansson 2020 on a Titan V, one eye, noise-free rays, \
    with antialiasing where stated; their speed-ups are relative to basic frames without antialiasing. Where they give \
    a range of SSIM, its middle.";

/// Returns a table with a line per scene, camera and mode.
pub fn andersson_table(rows: &[AnderssonRow]) -> Table {
    table(&SHOWN, rows)
}

const CSV: [Column<AnderssonRow>; 24] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("camera", |r| optional(r.camera)),
    ("mode", |r| r.mode.to_owned()),
    ("dispatched", |r| number(r.dispatched, 5)),
    ("traced", |r| number(r.traced, 5)),
    ("time_ms", |r| number(r.time_ms.map(|ms| ms[0]), 4)),
    ("time_ms_min", |r| number(r.time_ms.map(|ms| ms[1]), 4)),
    ("time_ms_max", |r| number(r.time_ms.map(|ms| ms[2]), 4)),
    ("speedup", |r| number(r.speedup, 4)),
    (PARTS[0].0, |r| number(part(r, 0), 4)),
    (PARTS[1].0, |r| number(part(r, 1), 4)),
    (PARTS[2].0, |r| number(part(r, 2), 4)),
    (PARTS[3].0, |r| number(part(r, 3), 4)),
    (PARTS[4].0, |r| number(part(r, 4), 4)),
    (PARTS[5].0, |r| number(part(r, 5), 4)),
    ("flip", |r| number(r.flip, 6)),
    ("flip_acuity", |r| number(r.flip_acuity, 6)),
    ("flip_foveated", |r| number(r.flip_foveated, 6)),
    ("flicker", |r| number(r.flicker, 6)),
    ("ssim_gaze", |r| number(r.ssim[0], 6)),
    ("ssim_edge", |r| number(r.ssim[1], 6)),
    ("ssim_basic_gaze", |r| number(r.ssim_basic[0], 6)),
    ("ssim_basic_edge", |r| number(r.ssim_basic[1], 6)),
];

/// Returns the contents of `andersson.csv`.
pub fn andersson_csv(rows: &[AnderssonRow]) -> Csv {
    Csv::new(&CSV, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The thesis's rings end at 0.682 of 60 degrees.
    #[test]
    fn twenty_rings_of_the_thesiss_width_reach_the_corners() {
        for (width, height) in [(1920, 1080), (640, 360), (100, 100)] {
            let Viewing { gaze, yfov_deg } = viewing(Extent::new(width, height));
            let per_pixel = 2.0 * (yfov_deg.to_radians() / 2.0).tan() / f64::from(height);
            let corner = (f64::from(width).hypot(f64::from(height)) / 2.0 * per_pixel).atan().to_degrees();
            assert!((corner / 20.0 - 2.05).abs() < 0.01 && (corner - 0.682 * 60.0).abs() < 0.05, "{corner}");
            assert_eq!(gaze, [0.5; 2]);
        }
    }

    #[test]
    fn what_is_cited_is_as_fast_as_the_thesis_says() {
        let rows = cited();
        assert_eq!(rows.len(), 4 * 4 + 3 * 4);
        let csv = andersson_csv(&rows);
        let of = |scene: &str, mode: &str, name: &str| {
            let is = |i: &usize| rows[*i].scene == scene && rows[*i].mode == mode;
            csv.value((0..rows.len()).find(is).unwrap(), name).to_owned()
        };
        assert_eq!(of("Sponza", "composite", "speedup"), "1.6382");
        assert_eq!(of("Bistro, antialiased", "composite-kernel", "speedup"), "1.7816");
        assert_eq!(of("Bistro", "fov", "speedup"), "0.7705");
        assert_eq!(of("Sponza", "kernel", "traced"), "0.65700");
        let shown = andersson_table(&rows).rows;
        let moving = shown.iter().find(|row| row[2] == "moving").unwrap();
        assert_eq!((moving[3].as_str(), moving[18].as_str(), moving[6].as_str()), ("fov", "0.960, 0.920", "-"));
    }
}
