//! Compares late reprojection (timewarp) with no correction. Frames are displayed with a latency of some frames after
//! their pose was sampled, and compared with frames rendered at the pose of the display time (the true pose).

use serde::Serialize;

use super::Table;
use super::csv::{Column, Csv, number, optional};
use super::study::{cell, table};

/// Latencies to measure: numbers of frames between the rendering pose and the pose at display time.
pub const LATENCIES: [u32; 3] = [1, 2, 4];

/// Overscan on each side, degrees.
pub const BORDER_DEG: f64 = 6.0;

/// Results for a latency on a shot: means over instants and eyes, and maxima.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LateRow {
    pub scene: String,
    pub latency_frames: u32,
    pub latency_ms: f64,
    pub instants: u32,
    /// Mean rotation (degrees) and translation (millimetres) of the head during the latency.
    pub turned_deg: f64,
    pub moved_mm: f64,
    /// FLIP against a frame rendered at the true pose. `flip`: the uncorrected frame; `flip_corrected`: the reprojected
    /// frame; `flip_noise`: another frame at the true pose with different random numbers. Fields ending in `most` are
    /// maxima over instants and eyes, the others means.
    pub flip: f64,
    pub flip_most: f64,
    pub flip_corrected: f64,
    pub flip_corrected_most: f64,
    pub flip_noise: f64,
}

/// Measurements at one instant: head motion during the latency, and FLIP of each eye for the uncorrected frame, the
/// reprojected frame, and a frame at the true pose with other random numbers.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    pub turned_deg: f64,
    pub moved_mm: f64,
    pub flips: [[f64; 2]; 3],
}

impl LateRow {
    /// Summarises the measurements of a latency. `instants` must not be empty.
    pub fn of(scene: &str, latency_frames: u32, fps: f64, instants: &[Instant]) -> Self {
        let mean = |of: &dyn Fn(&Instant) -> f64| instants.iter().map(of).sum::<f64>() / instants.len().max(1) as f64;
        let flip = |which: usize| mean(&|i| (i.flips[which][0] + i.flips[which][1]) / 2.0);
        let most = |which: usize| instants.iter().flat_map(|i| i.flips[which]).fold(0.0, f64::max);
        Self {
            scene: scene.to_owned(),
            latency_frames,
            latency_ms: 1e3 * f64::from(latency_frames) / fps,
            instants: instants.len() as u32,
            turned_deg: mean(&|i| i.turned_deg),
            moved_mm: mean(&|i| i.moved_mm),
            flip: flip(0),
            flip_most: most(0),
            flip_corrected: flip(1),
            flip_corrected_most: most(1),
            flip_noise: flip(2),
        }
    }
}

/// The caption of [`late_table`].
pub const NOTE: &str = "Frames are rendered without denoising, with 6 degrees of overscan, and displayed 'frames late' \
    frames after their pose was sampled: once uncorrected, once reprojected with depth to the pose at display time. \
    FLIP compares them with a frame rendered at that pose; values are means over instants and eyes, 'most' is the \
    maximum. noise: FLIP of two frames at that pose with different random numbers, the lower bound. turned, moved: \
    head motion during the latency.";

const SHOWN: [Column<LateRow>; 9] = [
    ("scene", |r| r.scene.clone()),
    ("frames late", |r| r.latency_frames.to_string()),
    ("ms", |r| cell(Some(r.latency_ms), 1)),
    ("turned deg", |r| cell(Some(r.turned_deg), 2)),
    ("moved mm", |r| cell(Some(r.moved_mm), 1)),
    ("FLIP (most)", |r| format!("{:.4} ({:.4})", r.flip, r.flip_most)),
    ("corrected (most)", |r| format!("{:.4} ({:.4})", r.flip_corrected, r.flip_corrected_most)),
    ("noise", |r| cell(Some(r.flip_noise), 4)),
    ("instants", |r| r.instants.to_string()),
];

/// Returns a table with a line per scene and latency.
pub fn late_table(rows: &[LateRow]) -> Table {
    table(&SHOWN, rows)
}

const CSV: [Column<LateRow>; 11] = [
    ("scene", |r| r.scene.clone()),
    ("latency_frames", |r| optional(Some(r.latency_frames))),
    ("latency_ms", |r| number(Some(r.latency_ms), 3)),
    ("instants", |r| optional(Some(r.instants))),
    ("turned_deg", |r| number(Some(r.turned_deg), 4)),
    ("moved_mm", |r| number(Some(r.moved_mm), 3)),
    ("flip", |r| number(Some(r.flip), 6)),
    ("flip_most", |r| number(Some(r.flip_most), 6)),
    ("flip_corrected", |r| number(Some(r.flip_corrected), 6)),
    ("flip_corrected_most", |r| number(Some(r.flip_corrected_most), 6)),
    ("flip_noise", |r| number(Some(r.flip_noise), 6)),
];

/// Returns the contents of `late.csv`.
pub fn late_csv(rows: &[LateRow]) -> Csv {
    Csv::new(&CSV, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_means_over_instants_and_eyes() {
        let instant = |by: f64| Instant {
            turned_deg: by,
            moved_mm: 10.0 * by,
            flips: [[0.1 * by, 0.3 * by], [0.02 * by, 0.02 * by], [0.01, 0.01]],
        };
        let row = LateRow::of("builtin:cornell", 2, 50.0, &[instant(1.0), instant(2.0)]);
        let csv = late_csv(&[row]);
        let names = ["latency_ms", "turned_deg", "moved_mm", "flip", "flip_most", "flip_corrected", "flip_noise"];
        let values = names.map(|name| csv.value(0, name).parse::<f64>().unwrap());
        let expected = [40.0, 1.5, 15.0, 0.3, 0.6, 0.03, 0.01];
        assert!(values.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{values:?}");
    }
}
