//! Deadlines of frames on a display, and the causes of missed ones.
//!
//! A frame on a display is due one period after the refresh at which it was to start. Its time consists of parts: the
//! delay of its start, host time before the first device begins, the tasks and waits of its critical path, and host
//! time after the last one. The cause of a missed deadline is the part that exceeded its expectation most: a task's is
//! the prediction of the cost model, that of another part its mean over frames in time.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::deadline::{Deadline, DisplayedFrame, Surroundings};
use super::frames::{FrameControl, path};
use super::median::median;
use super::summary::Step;
use super::work::Trace;
use super::{FIRST_DEVICE_PID, TraceError};
use crate::exec::FrameReport;
use crate::schedule::learned::Mean;

/// Fraction of the cores that other programs must take to be named as the cause.
const OTHERS_SHARE: f64 = 0.1;
/// Fraction of the cores that other programs must take to explain a pause of this process, too.
const OVERLOAD: f64 = 0.5;

/// A part of a frame's time, with the prediction of the cost model for tasks.
#[derive(Clone, Debug, PartialEq)]
struct Part {
    name: String,
    ms: f64,
    predicted_ms: Option<f64>,
}

/// Finds the causes of late frames. It learns the usual times of parts from frames in time.
#[derive(Debug, Default)]
pub struct LateCauses {
    usual: HashMap<String, Mean>,
    /// The last event, if no frame since was in time.
    event: Option<String>,
}

impl LateCauses {
    /// Returns the cause of a missed deadline; `None` for a frame in time. Call this for every frame.
    pub fn cause(
        &mut self,
        report: &FrameReport,
        deadline: &Deadline,
        control: &FrameControl,
        around: &Surroundings,
    ) -> Option<String> {
        self.cause_of(&parts(report, deadline), deadline, control, around)
    }

    fn cause_of(
        &mut self,
        parts: &[Part],
        deadline: &Deadline,
        control: &FrameControl,
        around: &Surroundings,
    ) -> Option<String> {
        let Surroundings { event, others, paused_ms } = around;
        if event.is_some() {
            self.event.clone_from(event);
        }
        if !deadline.is_missed() {
            self.learn(parts);
            self.event = None;
            return None;
        }
        if let Some(event) = &self.event {
            return Some(event.clone());
        }
        let usual_ms = |name: &str| self.usual.get(name).and_then(Mean::value).unwrap_or(0.0);
        let excess = |part: &Part| part.ms - part.predicted_ms.unwrap_or_else(|| usual_ms(&part.name));
        let most = parts.iter().map(|part| (excess(part), part)).max_by(|(a, _), (b, _)| a.total_cmp(b));
        let host_ms: f64 = [START, BEFORE, AFTER].into_iter().map(usual_ms).sum();
        // An unknown expectation is not a number, and exceeds nothing.
        let (most_ms, others) = (most.map_or(0.0, |(ms, _)| ms).max(0.0), others.unwrap_or(0.0));
        let planned_over_ms = |expected_ms: f64| expected_ms + host_ms - deadline.period_ms();
        if planned_over_ms(control.expected_ms) > most_ms {
            // Without other programs, the frame would take this fraction of the time.
            let is_due_to_others =
                others > OTHERS_SHARE && planned_over_ms(control.expected_ms * (1.0 - others)) <= 0.0;
            let planned = if control.fits { EXPECTED } else { UNFIT };
            return Some(if is_due_to_others { OTHERS } else { planned }.to_owned());
        }
        if others <= OVERLOAD && *paused_ms > 0.5 * most_ms {
            return Some(PAUSED.to_owned());
        }
        if others > OTHERS_SHARE {
            return Some(OTHERS.to_owned());
        }
        most.map(|(_, part)| part.name.clone())
    }

    fn learn(&mut self, parts: &[Part]) {
        for part in parts {
            self.usual.entry(part.name.clone()).or_default();
        }
        for (name, usual) in &mut self.usual {
            let part = parts.iter().find(|part| part.name == *name);
            usual.learn_with_zero(part.map_or(0.0, |part| part.ms.max(0.0)));
        }
    }
}

const START: &str = "late start";
const BEFORE: &str = "host before the frame";
const AFTER: &str = "host after the frame";
const EXPECTED: &str = "expected to exceed the period";
const UNFIT: &str = "no rung fits the budget";
const PAUSED: &str = "pause of the process";
const OTHERS: &str = "other programs";

/// Splits the time from the refresh at which a frame was to start until it was complete. Parts of the critical path
/// with the same name count as one.
fn parts(report: &FrameReport, deadline: &Deadline) -> Vec<Part> {
    let [before_ms, after_ms] = deadline.host_ms(report);
    let host = |name: &str, ms| Part { name: name.to_owned(), ms, predicted_ms: None };
    let mut parts =
        vec![host(START, deadline.started_ms - deadline.refresh_ms), host(BEFORE, before_ms), host(AFTER, after_ms)];
    for step in path(&report.tasks, report.begin_ms, report.makespan_ms) {
        let (name, ms, predicted_ms) = (part_name(&step), step.time_ms, step.predicted_ms);
        match parts.iter_mut().find(|part| part.name == name) {
            Some(part) => {
                part.ms += ms;
                part.predicted_ms = part.predicted_ms.zip(predicted_ms).map(|(sum, more)| sum + more);
            }
            None => parts.push(Part { name, ms, predicted_ms }),
        }
    }
    parts
}

/// Returns the name of a part of the critical path.
fn part_name(step: &Step) -> String {
    let device = step.pid.saturating_sub(FIRST_DEVICE_PID);
    match step.lane {
        None => format!("wait: {} on device {device}", step.what),
        Some(lane) if lane.is_transfer() => format!("{} on device {device}", lane.name()),
        Some(_) => format!("{} on device {device}", step.what),
    }
}

/// Late frames with the same cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CauseSum {
    pub cause: String,
    pub frames: usize,
    /// Sum of the times by which they were late, and the longest.
    pub over_deadline_ms: f64,
    pub most_ms: f64,
    pub missed_periods: u64,
}

/// The late frames of a trace.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LateSummary {
    /// Number of frames with a deadline.
    pub frames: usize,
    /// Median period of the display.
    pub period_ms: f64,
    /// Causes, the one of most frames first.
    pub causes: Vec<CauseSum>,
    /// Late frames, the longest delay first.
    pub late: Vec<DisplayedFrame>,
}

impl LateSummary {
    /// Returns the late frames of a trace.
    ///
    /// # Errors
    /// [`TraceError::NoDeadlines`], which names the trace by `origin`.
    pub fn of(trace: &Trace, origin: &str) -> Result<Self, TraceError> {
        let periods_ms = trace.deadlines.iter().map(|frame| frame.period_ms).collect();
        let period_ms = median(periods_ms).ok_or_else(|| TraceError::NoDeadlines { path: origin.to_owned() })?;
        let mut late: Vec<_> = trace.deadlines.iter().filter(|frame| frame.missed_periods > 0).cloned().collect();
        late.sort_by(|a, b| b.over_deadline_ms.total_cmp(&a.over_deadline_ms));
        let mut causes: Vec<CauseSum> = Vec::new();
        for frame in &late {
            let cause = frame.cause.as_deref().unwrap_or("unknown");
            let new = || CauseSum {
                cause: cause.to_owned(),
                frames: 0,
                over_deadline_ms: 0.0,
                most_ms: 0.0,
                missed_periods: 0,
            };
            let place = causes.iter().position(|sum| sum.cause == cause).unwrap_or_else(|| {
                causes.push(new());
                causes.len() - 1
            });
            let sum = &mut causes[place];
            sum.frames += 1;
            sum.over_deadline_ms += frame.over_deadline_ms;
            sum.most_ms = sum.most_ms.max(frame.over_deadline_ms);
            sum.missed_periods += frame.missed_periods;
        }
        causes.sort_by_key(|sum| std::cmp::Reverse(sum.frames));
        Ok(Self { frames: trace.deadlines.len(), period_ms, causes, late })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_MS: f64 = 16.0;

    /// Times of a frame's parts; the stage has a prediction of 8 ms.
    fn parts([start, before, stage, wait, after]: [f64; 5]) -> (Vec<Part>, Deadline) {
        let part = |name: &str, ms, predicted_ms| Part { name: name.to_owned(), ms, predicted_ms };
        let complete_ms = start + before + stage + wait + after;
        let missed_periods = (complete_ms / PERIOD_MS) as u32;
        let parts = vec![
            part(START, start, None),
            part(BEFORE, before, None),
            part(AFTER, after, None),
            part("path_trace on device 1", stage, Some(8.0)),
            part("wait: hand-over on device 0", wait, None),
        ];
        (parts, Deadline { started_ms: start, complete_ms, due_ms: PERIOD_MS, missed_periods, refresh_ms: 0.0 })
    }

    struct Run(LateCauses);

    impl Run {
        /// Begins with frames in time that take 12 ms.
        fn new() -> Self {
            let mut run = Self(LateCauses::default());
            for _ in 0..8 {
                assert_eq!(run.frame([0.0, 1.0, 8.0, 2.0, 1.0]), None);
            }
            run
        }

        fn frame(&mut self, times: [f64; 5]) -> Option<String> {
            self.with(times, 12.0, None, None)
        }

        fn with(
            &mut self,
            times: [f64; 5],
            expected_ms: f64,
            event: Option<&str>,
            others: Option<f64>,
        ) -> Option<String> {
            let (parts, deadline) = parts(times);
            let fits = expected_ms <= 20.0;
            let control = FrameControl { rung: 0, budget_ms: [11.0, 20.0], expected_ms, fits, shown: None };
            let around = Surroundings { event: event.map(ToOwned::to_owned), others, paused_ms: 0.0 };
            self.0.cause_of(&parts, &deadline, &control, &around)
        }
    }

    #[test]
    fn largest_excess_over_expectation_is_the_cause() {
        let mut run = Run::new();
        for (times, cause) in [
            ([9.0, 1.0, 8.0, 2.0, 1.0], START),
            ([0.0, 7.0, 9.0, 2.0, 1.0], BEFORE),
            ([0.0, 1.0, 15.0, 2.0, 1.0], "path_trace on device 1"),
            ([0.0, 1.0, 9.0, 9.0, 1.0], "wait: hand-over on device 0"),
            ([0.0, 1.0, 8.0, 4.0, 9.0], AFTER),
        ] {
            assert_eq!(run.frame(times).as_deref(), Some(cause), "{times:?}");
        }
    }

    #[test]
    fn event_explains_late_frames_until_one_is_in_time() {
        let (mut run, late) = (Run::new(), [0.0, 1.0, 15.0, 2.0, 1.0]);
        assert_eq!(run.with(late, 12.0, Some("scene cut"), Some(0.9)).as_deref(), Some("scene cut"));
        assert_eq!(run.frame(late).as_deref(), Some("scene cut"));
        assert_eq!(run.frame([0.0, 1.0, 8.0, 2.0, 1.0]), None);
        assert_eq!(run.frame(late).as_deref(), Some("path_trace on device 1"));
        assert_eq!(run.with([0.0; 5], 12.0, Some("scene cut"), None), None);
    }

    #[test]
    fn other_programs_are_named_if_they_take_cores() {
        let (mut run, late) = (Run::new(), [0.0, 1.0, 15.0, 2.0, 1.0]);
        assert_eq!(run.with(late, 12.0, None, Some(0.4)).as_deref(), Some(OTHERS));
        assert_eq!(run.with(late, 12.0, None, Some(0.02)).as_deref(), Some("path_trace on device 1"));
    }

    #[test]
    fn pause_of_the_process_is_named_if_it_is_long_enough() {
        let mut run = Run::new();
        let (parts, deadline) = parts([0.0, 1.0, 18.0, 2.0, 1.0]);
        let control = FrameControl { rung: 0, budget_ms: [11.0, 20.0], expected_ms: 12.0, fits: true, shown: None };
        for (paused_ms, others, cause) in
            [(9.0, 0.0, PAUSED), (9.0, 0.3, PAUSED), (9.0, 0.8, OTHERS), (3.0, 0.0, "path_trace on device 1")]
        {
            let around = Surroundings { paused_ms, others: Some(others), event: None };
            assert_eq!(run.0.cause_of(&parts, &deadline, &control, &around).as_deref(), Some(cause));
        }
    }

    #[test]
    fn frames_planned_over_the_period_are_late() {
        let mut run = Run::new();
        assert_eq!(run.with([0.0, 1.0, 15.0, 2.0, 1.0], 18.0, None, None).as_deref(), Some("path_trace on device 1"));
        assert_eq!(run.with([0.0, 1.0, 9.0, 7.0, 1.0], 20.0, None, Some(0.05)).as_deref(), Some(EXPECTED));
        assert_eq!(run.with([0.0, 1.0, 9.0, 7.0, 1.0], 20.0, None, Some(0.5)).as_deref(), Some(OTHERS));
        assert_eq!(run.with([0.0, 1.0, 9.0, 7.0, 1.0], 40.0, None, Some(0.2)).as_deref(), Some(UNFIT));
        assert_eq!(run.with([0.0, 1.0, 9.0, 7.0, 1.0], 40.0, None, None).as_deref(), Some(UNFIT));
        assert!(run.with([0.0, 1.0, 9.0, 9.0, 1.0], f64::NAN, None, None).unwrap().starts_with("wait"));
    }
}
