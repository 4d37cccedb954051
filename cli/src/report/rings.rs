//! Summarises errors in rings around the gaze over several frames: means and deviations, as tables and charts.

use serde::Serialize;

use super::csv::{Column, Csv, number};
use super::statistics::{deviation, mean};
use super::{Chart, ReportError, Series, Table, cell, line_chart_svg, once};
use diptych::image::Extent;
use diptych::metrics::Pair;
use diptych::metrics::rings::{Ring, Viewing};
use diptych::quality::LogPolar;

/// Number of rings between the gaze and the farthest corner of the screen. All rings have the same width: 2.05 degrees
/// if the gaze is in the middle of the screen.
const RINGS: usize = 20;

/// Returns the viewing conditions of Andersson & Hansson 2020 (equation 5.1) for a screen of this size: the gaze is in
/// the middle, and the screen's diagonal divided by the viewing distance is tan 60°.
pub fn viewing(screen: Extent) -> Viewing {
    let (width, height) = (f64::from(screen.width), f64::from(screen.height));
    let tan_half = height / width.hypot(height) * LogPolar::DIAGONAL_DEG.to_radians().tan() / 2.0;
    Viewing { gaze: [0.5; 2], yfov_deg: 2.0 * tan_half.atan().to_degrees() }
}

/// Results of one mode (arrangement) in one ring: means over both eyes and all frames.
#[derive(Clone, Debug, Serialize)]
pub struct RingRow {
    pub scene: String,
    pub camera: &'static str,
    pub mode: &'static str,
    pub inner_deg: f64,
    pub outer_deg: f64,
    /// Number of pixels of the ring in one eye.
    pub pixels: usize,
    /// Number of frames.
    pub frames: usize,
    /// Errors against the reference. The deviation is the sample standard deviation over frames, if there are several.
    pub ssim: Option<f64>,
    pub ssim_deviation: Option<f64>,
    pub flip: Option<f64>,
    /// SSIM against the first mode's frames; `None` for the first mode itself.
    pub ssim_basic: Option<f64>,
    pub ssim_basic_deviation: Option<f64>,
}

/// Errors of a frame by eye and ring, once against the reference and once against the first mode's frame.
pub struct FrameRings {
    pub reference: [Vec<Ring>; 2],
    pub basic: Option<[Vec<Ring>; 2]>,
}

impl FrameRings {
    /// Computes the rings of both eyes. `eyes` compares them with the reference, `basic` with the first mode's frame.
    pub fn new(seen: &Viewing, eyes: &[Pair; 2], basic: Option<&[Pair; 2]>) -> Self {
        let rings = |eyes: &[Pair; 2]| eyes.each_ref().map(|eye| eye.rings(seen, RINGS));
        Self { reference: rings(eyes), basic: basic.map(rings) }
    }
}

/// Returns the SSIM against the reference in the innermost and in the outermost ring, then the SSIM against the first
/// mode ([`RingRow::ssim_basic`]) in the same order. The outermost ring is the last one whose SSIM is defined.
pub fn ends(rows: &[RingRow]) -> [Option<f64>; 4] {
    let ends = |ssim: fn(&RingRow) -> Option<f64>| [rows.first().and_then(ssim), rows.iter().rev().find_map(ssim)];
    let [[near, far], [near_basic, far_basic]] = [ends(|ring| ring.ssim), ends(|ring| ring.ssim_basic)];
    [near, far, near_basic, far_basic]
}

/// Summarises each ring of a mode over the mode's `frames`, all of which must have the same number of rings.
pub fn over_frames(scene: &str, camera: &'static str, mode: &'static str, frames: &[FrameRings]) -> Vec<RingRow> {
    let Some(first) = frames.first() else { return Vec::new() };
    let row = |(i, ring): (usize, &Ring)| {
        let of_frame = |eyes: &[Vec<Ring>; 2], of: fn(&Ring) -> Option<f64>| {
            let [left, right] = eyes.each_ref().map(|rings| rings.get(i).and_then(of));
            Some((left? + right?) / 2.0)
        };
        let of_all = |of: &dyn Fn(&FrameRings) -> Option<f64>| frames.iter().map(of).collect::<Option<Vec<f64>>>();
        let ssim = of_all(&|frame| of_frame(&frame.reference, |ring| ring.ssim));
        let flip = of_all(&|frame| of_frame(&frame.reference, |ring| ring.flip));
        let basic = of_all(&|frame| of_frame(frame.basic.as_ref()?, |ring| ring.ssim));
        let spread = |all: &Option<Vec<f64>>| all.as_ref().filter(|all| all.len() > 1).map(|all| deviation(all));
        RingRow {
            scene: scene.to_owned(),
            camera,
            mode,
            inner_deg: ring.inner_deg,
            outer_deg: ring.outer_deg,
            pixels: ring.pixels,
            frames: frames.len(),
            ssim: ssim.as_deref().map(mean),
            ssim_deviation: spread(&ssim),
            flip: flip.as_deref().map(mean),
            ssim_basic: basic.as_deref().map(mean),
            ssim_basic_deviation: spread(&basic),
        }
    };
    first.reference[0].iter().enumerate().map(row).collect()
}

const CSV: [Column<RingRow>; 12] = [
    ("scene", |r| r.scene.clone()),
    ("camera", |r| r.camera.to_owned()),
    ("mode", |r| r.mode.to_owned()),
    ("inner_deg", |r| format!("{:.4}", r.inner_deg)),
    ("outer_deg", |r| format!("{:.4}", r.outer_deg)),
    ("pixels", |r| r.pixels.to_string()),
    ("frames", |r| r.frames.to_string()),
    ("ssim", |r| number(r.ssim, 6)),
    ("ssim_deviation", |r| number(r.ssim_deviation, 6)),
    ("ssim_basic", |r| number(r.ssim_basic, 6)),
    ("ssim_basic_deviation", |r| number(r.ssim_basic_deviation, 6)),
    ("flip", |r| number(r.flip, 6)),
];

/// Returns the contents of `rings.csv`.
pub fn ring_csv(rows: &[RingRow]) -> Csv {
    Csv::new(&CSV, rows)
}

/// Selects a measure of a ring and its standard deviation.
type Measure = fn(&RingRow) -> (Option<f64>, Option<f64>);

const MEASURES: [(&str, Measure); 2] =
    [("reference", |r| (r.ssim, r.ssim_deviation)), ("basic", |r| (r.ssim_basic, r.ssim_basic_deviation))];

/// The caption of [`ring_table`] and of the charts.
pub const NOTE: &str = "SSIM by angle from the gaze: mean over frames and both eyes, and the standard deviation over \
    frames. It is computed on tonemapped values, as the mean of three channels (the thesis uses luma), in 11x11 \
    Gaussian windows that lie inside the image. It compares with the reference, and with the basic mode's frame of the \
    same instant and number of samples. The viewing distance is the thesis's: half of the screen's diagonal spans 40.9 \
    degrees.";

/// Returns a table with a column per mode, and a line per scene, camera, target of comparison (the reference or the
/// first mode) and ring.
pub fn ring_table(rows: &[RingRow], modes: &[&'static str]) -> Table {
    let mut headers = vec!["scene", "camera", "against", "degrees"];
    headers.extend(modes);
    let mut lines = Vec::new();
    for (scene, camera) in once(rows.iter().map(|r| (r.scene.clone(), r.camera))) {
        let own: Vec<&RingRow> = rows.iter().filter(|r| r.scene == scene && r.camera == camera).collect();
        for (against, measure) in MEASURES {
            for ring in own.iter().filter(|r| Some(&r.mode) == modes.first()) {
                let degrees = format!("{:.1}–{:.1}", ring.inner_deg, ring.outer_deg);
                let mut line = vec![scene.clone(), camera.to_owned(), against.to_owned(), degrees];
                line.extend(modes.iter().map(|mode| {
                    let of = own.iter().find(|r| r.mode == *mode && r.inner_deg == ring.inner_deg);
                    let (value, deviation) = of.map_or((None, None), |r| measure(r));
                    let deviation = deviation.map_or(String::new(), |d| format!(" ± {d:.4}"));
                    cell(value, 4) + &deviation
                }));
                lines.push(line);
            }
        }
    }
    Table { headers, rows: lines }
}

/// Draws a chart for each scene, camera and target of comparison (the reference or the first mode) that has data.
///
/// # Errors
/// [`ReportError::Drawing`].
pub fn ring_charts(rows: &[RingRow], modes: &[&str]) -> Result<String, ReportError> {
    let mut charts = String::new();
    for (scene, camera) in once(rows.iter().map(|r| (r.scene.as_str(), r.camera))) {
        for (against, measure) in MEASURES {
            let series = |mode: &&str| {
                let own = rows.iter().filter(|r| (r.scene.as_str(), r.camera, r.mode) == (scene, camera, *mode));
                let (mut points, mut band) = (Vec::new(), Vec::new());
                for ring in own {
                    let (Some(ssim), deviation) = measure(ring) else { continue };
                    let spread = deviation.unwrap_or(0.0);
                    points.push(((ring.inner_deg + ring.outer_deg) / 2.0, ssim));
                    band.push((ssim - spread, ssim + spread));
                }
                Series { name: (*mode).to_owned(), points, band: Some(band), ..Series::default() }
            };
            // The first mode appears only in charts against the reference. It comes last, so that the other modes have
            // the same colours in all charts.
            let order = modes.iter().skip(1).chain(modes.first());
            let series: Vec<Series> = order.map(series).filter(|series| !series.points.is_empty()).collect();
            if series.is_empty() {
                continue;
            }
            let title = format!("{scene}, camera {camera}: against {against}");
            charts += &line_chart_svg(&Chart::new(title, ["degrees from the gaze", "SSIM"], false), &series)?;
        }
    }
    Ok(charts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(ssim: [f64; 2], basic: Option<f64>) -> FrameRings {
        let ring = |ssim: f64| {
            let of = |inner_deg, ssim| Ring {
                inner_deg,
                outer_deg: inner_deg + 2.0,
                pixels: 7,
                rmse: None,
                relmse: None,
                psnr: None,
                ssim,
                flip: Some(0.25),
            };
            vec![of(0.0, Some(ssim)), of(2.0, None)]
        };
        FrameRings { reference: ssim.map(ring), basic: basic.map(|ssim| [ring(ssim), ring(ssim)]) }
    }

    /// The rings of Andersson & Hansson end at 0.682 of 60 degrees.
    #[test]
    fn twenty_rings_reach_the_corners() {
        for (width, height) in [(1920, 1080), (640, 360), (100, 100)] {
            let Viewing { gaze, yfov_deg } = viewing(Extent::new(width, height));
            let per_pixel = 2.0 * (yfov_deg.to_radians() / 2.0).tan() / f64::from(height);
            let corner = (f64::from(width).hypot(f64::from(height)) / 2.0 * per_pixel).atan().to_degrees();
            assert!((corner / 20.0 - 2.05).abs() < 0.01 && (corner - 0.682 * 60.0).abs() < 0.05, "{corner}");
            assert_eq!(gaze, [0.5; 2]);
        }
    }

    #[test]
    fn rings_are_means_of_eyes_and_frames() {
        let of = |mode, frames: &[FrameRings]| over_frames("builtin:cornell", "still", mode, frames);
        let mut rows = of("basic", &[frame([0.5, 0.7], None), frame([0.7, 0.9], None)]);
        rows.extend(of("fov", &[frame([0.5, 0.5], Some(0.9))]));
        let csv = ring_csv(&rows);
        let names = ["mode", "outer_deg", "frames", "ssim", "ssim_deviation", "ssim_basic", "flip"];
        let found = |line| names.map(|name| csv.value(line, name));
        assert_eq!(found(0), ["basic", "2.0000", "2", "0.700000", "0.141421", "", "0.250000"]);
        assert_eq!(found(1), ["basic", "4.0000", "2", "", "", "", "0.250000"]);
        assert_eq!(found(2), ["fov", "2.0000", "1", "0.500000", "", "0.900000", "0.250000"]);
        let table = ring_table(&rows, &["basic", "fov"]).rows;
        assert_eq!(table[0], ["builtin:cornell", "still", "reference", "0.0–2.0", "0.7000 ± 0.1414", "0.5000"]);
        assert_eq!(table[2][2..], ["basic", "0.0–2.0", "-", "0.9000"]);
        assert_eq!(table.len(), 2 * 2);
        let charts = ring_charts(&rows, &["basic", "fov"]).unwrap();
        assert_eq!(charts.matches("<svg").count(), 2);
        assert!(charts.contains("camera still: against basic"));
        // A ring without a defined SSIM gives no chart.
        assert_eq!(ring_charts(&rows[1..2], &["basic"]).unwrap(), "");
        assert!(over_frames("builtin:cornell", "still", "fov", &[]).is_empty());
    }
}
