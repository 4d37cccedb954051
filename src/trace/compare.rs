//! Compares two traces by medians over their frames: times of stages and transfers, and metrics of whole frames.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::summary::{FrameSummary, Summary, median};
use super::work::Trace;
use super::{Lane, TraceError};

/// A metric, compared between the traces: its median over the frames of trace `a`, and over those of trace `b`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    pub what: String,
    pub a: f64,
    pub b: f64,
    /// `b` - `a`.
    pub difference: f64,
    /// `b` over `a`; none if `a` is 0.
    pub ratio: Option<f64>,
}

/// One of the two traces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Side {
    pub name: String,
    pub devices: usize,
    pub frames: usize,
    pub warnings: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    pub a: Side,
    pub b: Side,
    /// Times of each stage on each eye, and of transfers, in milliseconds per frame, summed over devices; largest
    /// difference first.
    pub stages: Vec<Change>,
    /// Metrics of frames, such as the makespan; names include the unit. Largest factor of change first.
    pub frames: Vec<Change>,
}

impl Comparison {
    /// Compares two traces, each given with its label.
    ///
    /// # Errors
    /// [`TraceError::NoFrames`]
    pub fn of([a, b]: [(&Trace, &str); 2]) -> Result<Comparison, TraceError> {
        let (a, a_side) = side(a)?;
        let (b, b_side) = side(b)?;
        let mut stages: Vec<Change> = stages(&a, &b);
        stages.sort_by(|x, y| y.difference.abs().total_cmp(&x.difference.abs()));
        let mut frames: Vec<Change> = frames(&a, &b);
        frames.sort_by(|x, y| y.factor().total_cmp(&x.factor()));
        Ok(Comparison { a: a_side, b: b_side, stages, frames })
    }
}

fn side((trace, name): (&Trace, &str)) -> Result<(Vec<FrameSummary>, Side), TraceError> {
    let summary = Summary::of(trace);
    if summary.frames.is_empty() {
        return Err(TraceError::NoFrames { path: name.to_owned() });
    }
    let (devices, frames) = (summary.devices.len(), summary.frames.len());
    Ok((summary.frames, Side { name: name.to_owned(), devices, frames, warnings: summary.warnings }))
}

impl Change {
    fn new(what: String, [a, b]: [f64; 2]) -> Change {
        Change { what, a, b, difference: b - a, ratio: (a != 0.0).then(|| b / a) }
    }

    /// Returns the size of the change, up or down, as |ln(b / a)|: 0 if there is none, infinite if one side is 0.
    fn factor(&self) -> f64 {
        if self.difference == 0.0 { 0.0 } else { self.ratio.map_or(f64::INFINITY, |ratio| ratio.ln().abs()) }
    }
}

fn stages(a: &[FrameSummary], b: &[FrameSummary]) -> Vec<Change> {
    let all = a.iter().chain(b).flat_map(|frame| &frame.stages);
    let keys: BTreeSet<(&str, Lane)> = all.map(|time| (time.stage.as_str(), time.lane)).collect();
    let changes = keys.into_iter().map(|(stage, lane)| {
        let time_ms = |frame: &FrameSummary| {
            let times = frame.stages.iter();
            times.filter(|t| t.stage == stage && t.lane == lane).map(|t| t.time_ms).sum::<f64>()
        };
        let median_ms = |frames: &[FrameSummary]| median(frames.iter().map(time_ms).collect()).unwrap_or(0.0);
        Change::new(format!("{stage} {}", lane.name()), [a, b].map(median_ms))
    });
    changes.collect()
}

fn frames(a: &[FrameSummary], b: &[FrameSummary]) -> Vec<Change> {
    type Measure = fn(&FrameSummary) -> Option<f64>;
    const MEASURES: [(&str, Measure); 7] = [
        ("makespan ms", |f| Some(f.makespan_ms)),
        ("busy ms", |f| Some(f.busy_ms)),
        ("transfer ms", |f| Some(f.transfer_ms)),
        ("idle ms", |f| Some(f.idle_ms)),
        ("waits on critical path ms", |f| Some(f.wait_ms)),
        ("imbalance", |f| f.imbalance),
        ("rows moved MB", |f| Some(f.bytes as f64 / 1e6)),
    ];
    let changes = MEASURES.into_iter().filter_map(|(what, of)| {
        let middle = |frames: &[FrameSummary]| median(frames.iter().filter_map(of).collect());
        Some(Change::new(what.to_owned(), [middle(a)?, middle(b)?]))
    });
    changes.collect()
}

#[cfg(test)]
mod tests {
    use super::super::work::{Device, Task};
    use super::*;

    /// Creates a trace of one device. In each frame, given as (ms, bytes), the device traces paths for `ms`
    /// milliseconds, and two uploads of `bytes` bytes follow.
    fn trace(frames: &[(f64, u64)]) -> Trace {
        let device = Device { name: "gpu".to_owned(), clock_residual_us: None };
        let mut trace = Trace { devices: [(10, device)].into(), ..Trace::default() };
        for (frame, &(ms, bytes)) in frames.iter().enumerate() {
            let begin_us = 1e6 * frame as f64;
            let task = |lane, name: &str, begin_us, end_us| Task {
                pid: 10,
                lane,
                name: name.to_owned(),
                begin_us,
                end_us,
                frame: Some(frame as u64),
                rows: None,
                transfer: None,
                order: None,
                predicted_us: None,
                submissions: None,
                bytes: (lane == Lane::Upload).then_some(bytes),
            };
            let end_us = begin_us + 1e3 * ms;
            trace.tasks.push(task(Lane::Left, "path_trace", begin_us, end_us));
            trace.tasks.push(task(Lane::Upload, "radiance", end_us, end_us + 500.0));
            trace.tasks.push(task(Lane::Upload, "guide", end_us + 500.0, end_us + 1000.0));
        }
        trace
    }

    #[test]
    fn medians_are_compared_largest_change_first() {
        // The first frames are slow in both.
        let (a, b) = (trace(&[(90.0, 8), (20.0, 8), (22.0, 8)]), trace(&[(80.0, 4), (10.0, 4), (11.0, 4)]));
        let comparison = Comparison::of([(&a, "a.json"), (&b, "b.json")]).unwrap();
        let found: Vec<_> = comparison.stages.iter().map(|c| (c.what.as_str(), c.a, c.b)).collect();
        assert_eq!(found, [("path_trace left", 22.0, 11.0), ("rows upload", 1.0, 1.0)]);
        assert_eq!((comparison.stages[0].difference, comparison.stages[0].ratio), (-11.0, Some(0.5)));
        let of = |what: &str| comparison.frames.iter().find(|c| c.what == what).unwrap();
        assert_eq!((of("makespan ms").a, of("makespan ms").b), (23.0, 12.0));
        assert_eq!((of("rows moved MB").a, of("rows moved MB").ratio), (16e-6, Some(0.5)));
        assert_eq!((of("idle ms").difference, of("idle ms").ratio), (0.0, None));
        assert_eq!(of("imbalance").ratio, Some(1.0));
        assert!(comparison.frames.is_sorted_by(|x, y| x.factor() >= y.factor()));
        assert_eq!(comparison.frames[0].ratio, Some(0.5));
        assert_eq!((comparison.a.name.as_str(), comparison.b.frames), ("a.json", 3));
    }

    #[test]
    fn stage_missing_in_one_trace_has_no_ratio() {
        let (a, mut b) = (trace(&[(5.0, 1)]), trace(&[(5.0, 1)]));
        b.tasks[0].name = "svgf".to_owned();
        let comparison = Comparison::of([(&a, "a"), (&b, "b")]).unwrap();
        let svgf = comparison.stages.iter().find(|c| c.what == "svgf left").unwrap();
        assert_eq!((svgf.a, svgf.b, svgf.ratio), (0.0, 5.0, None));
    }

    #[test]
    fn rejects_traces_without_frames_by_name() {
        let error = Comparison::of([(&trace(&[(5.0, 1)]), "a.json"), (&Trace::default(), "b.json")]).unwrap_err();
        assert!(error.to_string().contains("'b.json'"), "{error}");
    }
}
