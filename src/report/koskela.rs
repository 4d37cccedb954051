//! Reproduces Koskela et al. 2019, "Foveated Real-Time Path Tracing in Visual-Polar Space". Compares visual-polar
//! images with tracing every pixel of the screen and with other distributions of as many samples, and prints the
//! authors' numbers beside ours.

use serde::Serialize;

use super::Table;
use super::bench::Measured;
use super::csv::{Column, Csv, number};
use super::study::{cell, table};

/// Arrangements to compare, the baseline first.
pub const ARRANGEMENTS: [&str; 5] = ["full", "uniform", "linear", "visual-polar", "log-polar"];

/// Exponent of the kernel of log-polar images.
pub const LOG_POLAR_ALPHA: f64 = 4.0;

/// Degrees from the gaze at which the linear falloff begins and ends.
pub const FALLOFF_DEG: [f64; 2] = [10.0, 20.0];

/// Eccentricity that bounds the fovea in the flicker measurements, degrees, and the speed of the gaze there, degrees
/// per second.
pub const NEAR_DEG: f64 = 5.0;
pub const GAZE_DEG_PER_S: f64 = 15.0;

const PATHS: [&str; 2] = ["path_trace", "hole_fill"];
const FILTERS: [&str; 3] = ["accumulate", "variance", "svgf"];

/// Results of an arrangement on a scene.
#[derive(Clone, Debug, Serialize)]
pub struct KoskelaRow {
    /// `measured` or `cited`.
    pub source: &'static str,
    pub scene: String,
    pub arrangement: &'static str,
    /// Sampling probability beyond the linear falloff.
    pub floor: Option<f64>,
    /// Downsampling factor of log-polar images, per axis of the screen.
    pub sigma: Option<f64>,
    /// Pixels of each eye that start paths, over pixels of its screen.
    pub paths_left: Option<f64>,
    pub paths_right: Option<f64>,
    /// Median, minimum and maximum of the frames' makespans.
    pub time_ms: Option<[f64; 3]>,
    /// Times in ms, for both eyes and summed over devices: path tracing, the filter, the map to the screen, and the
    /// blur before it.
    pub path_ms: Option<f64>,
    pub filter_ms: Option<f64>,
    pub map_ms: Option<f64>,
    pub blur_ms: Option<f64>,
    /// Speedup of path tracing over the arrangement that traces every pixel.
    pub path_speedup: Option<f64>,
    /// Means of both eyes.
    pub flip: Option<f64>,
    pub flip_acuity: Option<f64>,
    pub flip_foveated: Option<f64>,
    /// Flicker of the whole image with a resting gaze.
    pub flicker: Option<f64>,
    /// FLIP and flicker of the fovea with a moving gaze.
    pub fovea_flip: Option<f64>,
    pub fovea_flicker: Option<f64>,
}

/// Settings and results of an arrangement that [`Measured`] lacks, which covers only frames with a static gaze.
#[derive(Clone, Copy, Debug)]
pub struct Beside {
    pub floor: Option<f64>,
    pub sigma: Option<f64>,
    /// Pixels that start paths, over pixels of the screen, left and right.
    pub paths: [f64; 2],
    /// FLIP and flicker of the fovea.
    pub fovea: [Option<f64>; 2],
}

/// Returns the rows of a scene, in the order of [`ARRANGEMENTS`].
pub fn measured(scene: &str, found: Vec<(Measured, Beside)>) -> Vec<KoskelaRow> {
    let row =
        |arrangement, (of, Beside { floor, sigma, paths, fovea: [fovea_flip, fovea_flicker] }): (Measured, Beside)| {
            let sum = |stages: &[&str]| {
                let own: Vec<f64> = stages.iter().filter_map(|stage| of.stage_ms.get(*stage).copied()).collect();
                (!own.is_empty()).then(|| own.iter().sum())
            };
            KoskelaRow {
                source: "measured",
                scene: scene.to_owned(),
                arrangement,
                floor,
                sigma,
                paths_left: Some(paths[0]),
                paths_right: Some(paths[1]),
                time_ms: Some([of.time_ms, of.time_ms_min, of.time_ms_max]),
                path_ms: sum(&PATHS),
                filter_ms: sum(&FILTERS),
                map_ms: sum(&["to_screen"]),
                blur_ms: sum(&["polar_blur"]),
                path_speedup: None,
                flip: Some(of.error("flip")),
                flip_acuity: Some(of.error("flip_acuity")),
                flip_foveated: Some(of.error("flip_foveated")),
                flicker: Some(of.error("flicker")),
                fovea_flip,
                fovea_flicker,
            }
        };
    let mut rows: Vec<KoskelaRow> = ARRANGEMENTS.into_iter().zip(found).map(|(name, found)| row(name, found)).collect();
    let full_ms = rows[0].path_ms;
    for row in &mut rows {
        row.path_speedup = full_ms.zip(row.path_ms).map(|(full, own)| full / own);
    }
    rows
}

/// Returns the authors' path tracing times (section 5) of the cheapest and the most expensive scene.
pub fn cited() -> Vec<KoskelaRow> {
    let row = |scene: &str, arrangement, path_ms| KoskelaRow {
        source: "cited",
        scene: scene.to_owned(),
        arrangement,
        floor: None,
        sigma: None,
        paths_left: None,
        paths_right: None,
        time_ms: None,
        path_ms: Some(path_ms),
        filter_ms: None,
        map_ms: None,
        blur_ms: None,
        path_speedup: None,
        flip: None,
        flip_acuity: None,
        flip_foveated: None,
        flicker: None,
        fovea_flip: None,
        fovea_flicker: None,
    };
    let scenes = [("least of the paper's", 20.0, 8.0), ("most of the paper's", 56.0, 22.0)];
    let of_scene = |(scene, full_ms, polar_ms)| {
        let full = KoskelaRow { paths_left: Some(1.0), path_speedup: Some(1.0), ..row(scene, "full", full_ms) };
        let polar = KoskelaRow {
            paths_left: Some(0.39),
            filter_ms: Some(2.4),
            map_ms: Some(0.8),
            blur_ms: Some(0.8),
            path_speedup: Some(2.5),
            ..row(scene, "visual-polar", polar_ms)
        };
        [full, polar]
    };
    scenes.into_iter().flat_map(of_scene).collect()
}

fn percent(share: Option<f64>) -> String {
    cell(share.map(|share| 100.0 * share), 1)
}

const SHOWN: [Column<KoskelaRow>; 18] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("arrangement", |r| r.arrangement.to_owned()),
    ("floor %", |r| percent(r.floor)),
    ("σ", |r| cell(r.sigma, 3)),
    ("paths %, left, right", |r| format!("{}, {}", percent(r.paths_left), percent(r.paths_right))),
    ("frame ms", |r| cell(r.time_ms.map(|ms| ms[0]), 1)),
    ("path ms", |r| cell(r.path_ms, 2)),
    ("speed-up", |r| cell(r.path_speedup, 2)),
    ("filter ms", |r| cell(r.filter_ms, 2)),
    ("map ms", |r| cell(r.map_ms, 2)),
    ("blur ms", |r| cell(r.blur_ms, 2)),
    ("FLIP", |r| cell(r.flip, 4)),
    ("by acuity", |r| cell(r.flip_acuity, 4)),
    ("foveated", |r| cell(r.flip_foveated, 4)),
    ("flicker", |r| cell(r.flicker, 5)),
    ("fovea's FLIP", |r| cell(r.fovea_flip, 4)),
    ("fovea's flicker", |r| cell(r.fovea_flicker, 5)),
];

/// The caption of [`koskela_table`].
pub const NOTE: &str = "1 sample per sampled pixel, 6 bounces, svgf with 5 iterations everywhere; the camera follows \
    its path and stops. The arrangements take turns frame by frame. full: every pixel of the screen. uniform: a render \
    scale with as many samples as visual-polar. linear: every pixel within 10 degrees of the gaze; further out, the \
    probability falls linearly to a floor at 20 degrees, chosen for the same number of samples. log-polar: kernel \
    exponent 4, the aspect ratio of the screen, no full-resolution area, and σ chosen for the same number of traced \
    pixels. paths: pixels that start paths over pixels of the screen, including those at silhouettes, which are always \
    traced. frame: median. path: path tracing and hole filling, and its speed-up over full. filter: accumulation, \
    variance and iterations. map, blur: resampling the polar image to the screen. Stage times are medians of the sum \
    over all devices. FLIP, also weighted by the acuity of visual-polar space and by Geisler & Perry's, and flicker \
    are for a static gaze, means of both eyes. The fovea's FLIP and flicker are for pixels within 5 degrees of the \
    gaze while it moves at 15 degrees per second; flicker compares consecutive frames. Cited: Koskela et al. 2019 on a \
    Vega Frontier Edition, one eye of 1280x1440, bmfr; their map is 0.2 ms of mipmaps and 0.6 ms of mapping. Their \
    linear falloff has a floor of 20 % and 1.5 times the samples of visual-polar. Their viewers saw more artefacts in \
    the fovea with uniform (p = 8.2e-7) and linear samples (p = 0.0023) than with visual-polar ones, and more \
    distracting artefacts with log-polar ones (p = 0.0059), whose σ was 1.8.";

/// Returns a table with a line per scene and arrangement.
pub fn koskela_table(rows: &[KoskelaRow]) -> Table {
    table(&SHOWN, rows)
}

const CSV: [Column<KoskelaRow>; 21] = [
    ("source", |r| r.source.to_owned()),
    ("scene", |r| r.scene.clone()),
    ("arrangement", |r| r.arrangement.to_owned()),
    ("floor", |r| number(r.floor, 5)),
    ("sigma", |r| number(r.sigma, 5)),
    ("paths_left", |r| number(r.paths_left, 5)),
    ("paths_right", |r| number(r.paths_right, 5)),
    ("time_ms", |r| number(r.time_ms.map(|ms| ms[0]), 4)),
    ("time_ms_min", |r| number(r.time_ms.map(|ms| ms[1]), 4)),
    ("time_ms_max", |r| number(r.time_ms.map(|ms| ms[2]), 4)),
    ("path_ms", |r| number(r.path_ms, 4)),
    ("path_speedup", |r| number(r.path_speedup, 4)),
    ("filter_ms", |r| number(r.filter_ms, 4)),
    ("map_ms", |r| number(r.map_ms, 4)),
    ("blur_ms", |r| number(r.blur_ms, 4)),
    ("flip", |r| number(r.flip, 6)),
    ("flip_acuity", |r| number(r.flip_acuity, 6)),
    ("flip_foveated", |r| number(r.flip_foveated, 6)),
    ("flicker", |r| number(r.flicker, 6)),
    ("fovea_flip", |r| number(r.fovea_flip, 6)),
    ("fovea_flicker", |r| number(r.fovea_flicker, 6)),
];

/// Returns the contents of `koskela.csv`.
pub fn koskela_csv(rows: &[KoskelaRow]) -> Csv {
    Csv::new(&CSV, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exec::Stereo;
    use crate::report::bench::Errors;

    #[test]
    fn path_tracing_is_held_against_that_of_every_pixel() {
        let eye = |flip: f64| Errors::mean_of(&[serde_json::json!({ "flip": flip, "flicker": flip / 10.0 })]);
        let of = |path_ms: f64, more: &[(&str, f64)]| {
            let stages = [("path_trace", path_ms - 1.0), ("hole_fill", 1.0), ("accumulate", 2.0), ("svgf", 3.0)];
            Measured {
                time_ms: 2.0 * path_ms,
                time_ms_min: path_ms,
                time_ms_max: 3.0 * path_ms,
                stage_ms: stages.iter().chain(more).map(|(name, ms)| ((*name).to_owned(), *ms)).collect(),
                errors: Stereo { left: eye(0.1), right: eye(0.2) },
                relmse_repeats: Stereo { left: Vec::new(), right: Vec::new() },
                frames: Vec::new(),
            }
        };
        let beside = |floor, left| Beside { floor, sigma: None, paths: [left, 0.1], fovea: [Some(0.02), Some(0.01)] };
        let rows = measured(
            "builtin:cornell",
            vec![
                (of(10.0, &[]), beside(None, 1.0)),
                (of(5.0, &[]), beside(None, 0.4)),
                (of(8.0, &[]), beside(Some(0.2), 0.4)),
                (of(4.0, &[("to_screen", 0.5), ("polar_blur", 0.25)]), beside(None, 0.4)),
            ],
        );
        let csv = koskela_csv(&rows);
        let of_row = |i, names: [&str; 6]| names.map(|name| csv.value(i, name));
        let names = ["arrangement", "time_ms", "path_speedup", "filter_ms", "map_ms", "blur_ms"];
        assert_eq!(of_row(0, names), ["full", "20.0000", "1.0000", "5.0000", "", ""]);
        assert_eq!(of_row(3, names), ["visual-polar", "8.0000", "2.5000", "5.0000", "0.5000", "0.2500"]);
        let names = ["floor", "paths_left", "flip", "flicker", "fovea_flip", "fovea_flicker"];
        assert_eq!(of_row(2, names), ["0.20000", "0.40000", "0.150000", "0.015000", "0.020000", "0.010000"]);
        let shown = koskela_table(&cited()).rows;
        assert_eq!(shown[0][5..13], ["100.0, -", "-", "20.00", "1.00", "-", "-", "-", "-"]);
        assert_eq!(shown[3][5..13], ["39.0, -", "-", "22.00", "2.50", "2.40", "0.80", "0.80", "-"]);
    }

    /// The paper's factor is rounded.
    #[test]
    fn cited_times_give_the_cited_factor() {
        for [full, polar] in cited().as_chunks::<2>().0 {
            let ratio = full.path_ms.unwrap() / polar.path_ms.unwrap();
            assert!((ratio - polar.path_speedup.unwrap()).abs() < 0.05, "{polar:?}: {ratio}");
        }
    }
}
