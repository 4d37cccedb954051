//! A figure of a play over time: makespans in their budget, samples, rungs and disturbances. It follows the figures of
//! Leria et al. that show frame times and samples per pixel over frames.

use serde::Serialize;

use super::html::live;
use super::lanes::round;
use super::run::FrameRow;

/// Something that was done to a run.
#[derive(Clone, Debug, Serialize)]
pub struct Disturbed {
    pub name: String,
    /// The first frame, and the one after the last.
    pub from: u32,
    pub to: u32,
}

/// The data, with a column per quantity and a row per frame.
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
}

/// The figure, from rows that the control loop made. The page's swimlanes show the frame that is chosen in it.
///
/// # Errors
/// Those of [`live`].
pub fn timeline(
    budget_ms: [f64; 2],
    rungs: usize,
    rows: &[FrameRow],
    disturbed: &[Disturbed],
) -> serde_json::Result<String> {
    let told: Vec<_> = rows.iter().filter_map(|row| Some((row, row.control.as_ref()?))).collect();
    let finite = |ms: f64| ms.is_finite().then(|| round(ms));
    let data = Data {
        budget: budget_ms,
        rungs,
        disturbed,
        index: told.iter().map(|(r, _)| r.index).collect(),
        ms: told.iter().map(|(r, _)| round(r.makespan_ms)).collect(),
        expected: told.iter().map(|(_, c)| finite(c.expected_ms)).collect(),
        late: told.iter().map(|(_, c)| round(c.late_ms)).collect(),
        rung: told.iter().map(|(_, c)| c.rung).collect(),
        spp: told.iter().map(|(r, _)| round(r.quality.samples())).collect(),
        setting: told.iter().map(|(r, _)| r.quality.to_string()).collect(),
    };
    live("timeline", &data)
}
