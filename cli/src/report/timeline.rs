//! Draws a run of `play` over time: makespans and budget, samples per pixel, rungs, rows of each device, disturbances
//! and faults. The figure follows those of Leria et al. that show frame times and samples per pixel over frames.

use serde::Serialize;

use super::html::live;
use super::lanes::round;
use super::samples::SampledFrame;

/// A disturbance of a run, such as a slowed device, a scene cut or a fault, for the figure.
#[derive(Clone, Debug, Serialize)]
pub struct Disturbed {
    pub name: String,
    /// The first disturbed frame, and the one after the last. They are equal for a moment, such as a scene cut.
    pub from: u32,
    pub to: u32,
}

/// Data of the figure, with a column per quantity and a row per frame.
#[derive(Serialize)]
struct Data<'a> {
    budget: [f64; 2],
    rungs: usize,
    disturbed: &'a [Disturbed],
    index: Vec<u32>,
    ms: Vec<f64>,
    expected: Vec<Option<f64>>,
    late: Vec<f64>,
    rung: Vec<usize>,
    /// Mean samples per pixel.
    spp: Vec<f64>,
    setting: Vec<String>,
    /// Rows of each device.
    rows: Vec<&'a [u32]>,
    missed: Vec<u32>,
    /// Time by which each frame was late; negative if it was early.
    over: Vec<Option<f64>>,
    cause: Vec<Option<&'a str>>,
}

/// Returns the figure. Selecting a frame in it also selects the frame in the page's swimlanes.
///
/// # Errors
/// Errors of [`live`].
pub fn timeline(
    budget_ms: [f64; 2],
    rungs: usize,
    frames: &[SampledFrame],
    disturbed: &[Disturbed],
) -> serde_json::Result<String> {
    let finite = |ms: f64| ms.is_finite().then(|| round(ms));
    let data = Data {
        budget: budget_ms,
        rungs,
        disturbed,
        index: frames.iter().map(|f| f.index).collect(),
        ms: frames.iter().map(|f| round(f.makespan_ms)).collect(),
        expected: frames.iter().map(|f| finite(f.control.expected_ms)).collect(),
        late: frames.iter().map(|f| round(f.control.late_ms)).collect(),
        rung: frames.iter().map(|f| f.control.rung).collect(),
        spp: frames.iter().map(|f| round(f.quality.samples())).collect(),
        setting: frames.iter().map(|f| f.quality.to_string()).collect(),
        rows: frames.iter().map(|f| f.stripes.as_slice()).collect(),
        missed: frames.iter().map(|f| f.control.missed_periods).collect(),
        over: frames.iter().map(|f| f.deadline.as_ref().map(|d| round(d.over_deadline_ms))).collect(),
        cause: frames.iter().map(|f| f.deadline.as_ref().and_then(|d| d.cause.as_deref())).collect(),
    };
    live("timeline", &data)
}
