//! Records frames in a trace: their times, their stage tasks and transfers on the devices' lanes, arrows, and counters.

use std::collections::HashMap;

use super::critical::{What, critical_path};
use super::deadline::{Presented, Surroundings};
use super::event::{Args, Track, args_from};
use super::summary::Step;
use super::work::{Frame, FrameTime, Order, Task};
use super::{FIRST_DEVICE_PID, HOST_PID, Lane, Recorder};
use crate::exec::{Fault, FrameReport, TaskTiming, TimedTask};
use crate::passes::path_trace::PARTITION;
use crate::quality::{FrameQuality, Quality};

/// Rung that the controller chose for a frame, and the frame budget.
#[derive(Clone, Debug)]
pub struct FrameControl {
    /// Rung of the quality ladder, from 0.
    pub rung: usize,
    /// Lower and upper end of the budget, ms.
    pub budget_ms: [f64; 2],
    /// Makespan that the controller expected; NaN if it knew none.
    pub expected_ms: f64,
    /// True if any rung was expected to fit the budget.
    pub fits: bool,
    /// Deadline of the frame, if it was to appear on a display.
    pub shown: Option<Presented>,
}

/// Records a frame with its tasks, arrows and counters, and flushes the file. Recorder and renderer must count times
/// from the same origin.
pub fn record_frame(recorder: &Recorder, report: &FrameReport, quality: &Quality, control: Option<&FrameControl>) {
    if !recorder.is_on() {
        return;
    }
    let (tasks, time) = (tasks_from(&report.tasks, report.index), time_from(report));
    let spp = ("spp", quality.spp.mean());
    let mut args = args_from(&[("frame", time.frame as f64), spp]);
    args.insert("devices".to_owned(), numbers_text(&report.devices).as_str().into());
    if let Some((control, shown)) = control.and_then(|c| Some((c, c.shown.as_ref()?))) {
        let args = presented_args(report, quality, control, shown);
        recorder.presented(report.slot, [time.begin_us, time.end_us], report.index, shown, args);
    }
    recorder.frame(report.slot, time.begin_us, time.end_us, args);
    for task in &tasks {
        record_task(recorder, task, spp);
    }
    let frame = Frame { time, tasks: tasks.iter().collect() };
    record_transfers(recorder, &frame);
    record_critical_path(recorder, &frame);
    record_counters(recorder, report, quality, control);
    for &(device, residual_us) in &report.clock_residuals_us {
        note_residual(recorder, device, residual_us);
    }
    recorder.flush();
}

/// Returns the arguments of a frame on a display: what was expected of it, and what happened.
fn presented_args(report: &FrameReport, quality: &Quality, control: &FrameControl, shown: &Presented) -> Args {
    let Presented { deadline, cause, around: Surroundings { event, others, paused_ms } } = shown;
    let [before_ms, after_ms] = deadline.host_ms(report);
    let known = [
        Some(("frame", report.index.into())),
        Some(("over_deadline_ms", deadline.over_ms())),
        Some(("whole_ms", deadline.whole_ms())),
        Some(("host_before_ms", before_ms)),
        Some(("makespan_ms", report.makespan_ms)),
        Some(("host_after_ms", after_ms)),
        Some(("period_ms", deadline.period_ms())),
        Some(("missed_periods", deadline.missed_periods.into())),
        Some(("rung", control.rung as f64)),
        Some(("expected_ms", control.expected_ms)).filter(|(_, ms)| ms.is_finite()),
        report.predicted_ms.map(|ms| ("predicted_ms", ms)),
        others.map(|share| ("others_share", share)),
        Some(("paused_ms", *paused_ms)).filter(|(_, ms)| *ms > 0.0),
    ];
    let mut args = args_from(&known.into_iter().flatten().collect::<Vec<_>>());
    let quality = Some(FrameQuality::from(quality).to_string());
    for (name, text) in [("quality", &quality), ("disturbance", event), ("cause", cause)] {
        args.extend(text.as_deref().map(|text| (name.to_owned(), text.into())));
    }
    args
}

fn note_residual(recorder: &Recorder, device: usize, residual_us: f64) {
    recorder.note_residual(&format!("device_{device}"), residual_us);
}

/// Returns the critical path of a frame with these tasks.
pub fn path(tasks: &[TaskTiming], begin_ms: f64, makespan_ms: f64) -> Vec<Step> {
    let tasks = tasks_from(tasks, 0);
    let (begin_us, end_us) = (begin_ms * 1e3, (begin_ms + makespan_ms) * 1e3);
    let time = FrameTime { frame: 0, begin_us, end_us, devices: None };
    Step::path(&Frame { time, tasks: tasks.iter().collect() })
}

/// Returns the tasks of a frame in order of begin.
fn tasks_from(timings: &[TaskTiming], frame: u32) -> Vec<Task> {
    let mut tasks: Vec<Task> = timings.iter().map(|timing| task_from(timing, frame)).collect();
    tasks.sort_by(|a, b| a.begin_us.total_cmp(&b.begin_us).then(a.end_us.total_cmp(&b.end_us)));
    tasks
}

fn time_from(report: &FrameReport) -> FrameTime {
    let begin_us = report.begin_ms * 1e3;
    let end_us = begin_us + report.makespan_ms * 1e3;
    let devices = report.devices.iter().fold(0, |all, device| all | 1 << device);
    FrameTime { frame: report.index.into(), begin_us, end_us, devices: Some(devices) }
}

/// Formats numbers as a comma-separated list, such as `0,2`.
fn numbers_text(numbers: &[usize]) -> String {
    numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

fn task_from(timing: &TaskTiming, frame: u32) -> Task {
    let place = |&(device, number): &(usize, usize)| (FIRST_DEVICE_PID + device as u32, number as u64);
    let lane = match (timing.kind, timing.view) {
        (TimedTask::Download, _) => Lane::Download,
        (TimedTask::Upload, _) => Lane::Upload,
        (TimedTask::Gpu(_), eye) if eye.is_source() => Lane::Left,
        (TimedTask::Gpu(_), _) => Lane::Right,
    };
    Task {
        pid: FIRST_DEVICE_PID + timing.device as u32,
        lane,
        name: timing.stage.to_string(),
        begin_us: timing.begin_ms * 1e3,
        end_us: timing.end_ms * 1e3,
        frame: Some(frame.into()),
        rows: Some(timing.rows.start.into()..timing.rows.end.into()),
        transfer: timing.transfer.map(u64::from),
        bytes: timing.bytes,
        predicted_us: timing.predicted_ms.map(|ms| ms * 1e3),
        submissions: matches!(timing.kind, TimedTask::Gpu(_)).then_some(timing.submissions.into()),
        order: Some(Order { number: timing.number as u64, after: timing.after.iter().map(place).collect() }),
    }
}

fn record_task(recorder: &Recorder, task: &Task, spp: (&str, f64)) {
    let numbers = [
        ("frame", task.frame),
        ("row_begin", task.rows.as_ref().map(|rows| rows.start)),
        ("rows", task.rows.as_ref().map(|rows| rows.end - rows.start)),
        ("transfer", task.transfer),
        ("bytes", task.bytes),
        ("submissions", task.submissions),
        ("task", task.order.as_ref().map(|order| order.number)),
    ];
    let mut args: Vec<(&str, f64)> = numbers.iter().filter_map(|&(name, n)| Some((name, n? as f64))).collect();
    args.extend(task.predicted_us.map(|us| ("predicted_ms", us / 1e3)));
    if !task.lane.is_transfer() {
        args.push(spp);
    }
    let mut args = args_from(&args);
    let place = |(pid, number): &(u32, u64)| format!("{}.{number}", pid - FIRST_DEVICE_PID);
    let after: Vec<String> = task.order.iter().flat_map(|order| &order.after).map(place).collect();
    if !after.is_empty() {
        args.insert("after".to_owned(), after.join(" ").as_str().into());
    }
    let times_us = [task.begin_us, task.end_us];
    recorder.task(task.pid - FIRST_DEVICE_PID, task.lane, &task.name, times_us, args);
}

/// Returns a point of an arrow: the track of a task, and a time in µs.
fn point(task: &Task, at_us: f64) -> (Track, f64) {
    (task.lane.track(task.pid - FIRST_DEVICE_PID), at_us)
}

/// Returns the id of an arrow of a frame. `number` is the number of the transfer, or `u32::MAX` for the critical path.
fn arrow(frame: &Frame, number: u32) -> u64 {
    frame.time.frame << 32 | u64::from(number)
}

/// Records an arrow per transfer, from the end of its download to the end of its upload, which is later if their clocks
/// agree. Viewers take an arrow's direction from its times.
fn record_transfers(recorder: &Recorder, frame: &Frame) {
    let on = |lane| frame.tasks.iter().filter(move |t| t.lane == lane);
    let sent: HashMap<u64, &Task> = on(Lane::Download).filter_map(|&t| Some((t.transfer?, t))).collect();
    for task in on(Lane::Upload) {
        let Some((transfer, from)) = task.transfer.and_then(|t| Some((t, sent.get(&t)?))) else { continue };
        recorder.flow(
            arrow(frame, transfer as u32),
            "transfer",
            &[point(from, from.end_us), point(task, task.end_us.max(from.end_us))],
        );
    }
}

/// Records an arrow through the middles of the parts of the critical path.
fn record_critical_path(recorder: &Recorder, frame: &Frame) {
    let path = critical_path(frame);
    let points: Vec<_> = path
        .iter()
        .filter_map(|stretch| match stretch.what {
            What::Task(task) => Some(point(task, 0.5 * (stretch.begin_us + stretch.end_us))),
            What::Wait(_) => None,
        })
        .collect();
    recorder.flow(arrow(frame, u32::MAX), "critical path", &points);
}

fn record_counters(recorder: &Recorder, frame: &FrameReport, quality: &Quality, control: Option<&FrameControl>) {
    let at_us = frame.begin_ms * 1e3;
    let mut times = vec![("makespan", frame.makespan_ms)];
    if let Some(&FrameControl { rung, budget_ms: [lo_ms, hi_ms], .. }) = control {
        times.extend([("budget_lo", lo_ms), ("budget_hi", hi_ms)]);
        recorder.counter("rung", at_us, &[("rung", rung as f64)]);
    }
    recorder.counter("frame time (ms)", at_us, &times);
    if let Some(age_ms) = frame.pose_age_ms() {
        recorder.counter("age of the pose (ms)", at_us, &[("age", age_ms)]);
    }
    recorder.counter("spp", at_us, &[("spp", quality.spp.mean())]);
    recorder.counter("bounces", at_us, &[("bounces", f64::from(quality.bounces))]);
    recorder.counter("iterations", at_us, &[("iterations", f64::from(quality.most_iterations()))]);
    recorder.counter("render scale", at_us, &[("scale", quality.scale)]);
    if let Some(right) = frame.right_eye() {
        let shares = [
            ("reprojected", right.reprojected_fraction),
            ("antialiasing", right.antialiasing_fraction),
            ("holes", right.hole_fraction),
            ("unsampled", right.unsampled_fraction),
        ];
        recorder.counter("pixels of the right eye", at_us, &shares);
    }
    recorder.counter("bytes moved", at_us, &[("bytes", frame.uploaded_bytes() as f64)]);
    let stripes = frame.assignment.stripes(PARTITION, frame.program.main_eye());
    let rows = (0..stripes.devices()).map(|d| stripes.rows(d).len() as f64);
    record_shares(recorder, "share of rows", at_us, rows.collect());
    record_shares(recorder, "share of work", at_us, frame.busy_ms());
}

/// Records a counter with a series per device, as fractions that add up to 1.
fn record_shares(recorder: &Recorder, name: &str, at_us: f64, amounts: Vec<f64>) {
    let total: f64 = amounts.iter().sum();
    if total > 0.0 {
        let names: Vec<String> = (0..amounts.len()).map(|device| format!("device {device}")).collect();
        let shares: Vec<(&str, f64)> = names.iter().zip(amounts).map(|(n, a)| (n.as_str(), a / total)).collect();
        recorder.counter(name, at_us, &shares);
    }
}

/// Marks the time at which the fault of a device was detected, after which the device was dropped.
pub fn record_fault(recorder: &Recorder, fault: &Fault) {
    let frame = fault.frame.to_string();
    let args = [("frame", frame.as_str()), ("what", &fault.what)];
    recorder.mark(fault.device as u32, Lane::Both, "device taken out", fault.noticed_ms * 1e3, &args);
}

/// Names the devices of a run and records the error bounds of their clocks.
pub fn record_devices(recorder: &Recorder, devices: &[crate::device::DeviceInfo]) {
    for device in devices {
        let rank =
            device.rank.as_ref().map_or(String::new(), |rank| format!(" (rank {} on {})", rank.number, rank.host));
        recorder.device(device.index as u32, &format!("device {}: {}{rank}", device.index, device.name));
        note_residual(recorder, device.index, device.clock_residual_us);
    }
    recorder.note("host_pid", HOST_PID);
    recorder.flush();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::TraceFile;

    fn task(pid: u32, lane: Lane, [begin_us, end_us]: [f64; 2], order: Order) -> Task {
        let (name, transfer) = ("rows".to_owned(), lane.is_transfer().then_some(5));
        let (frame, rows, bytes, order) = (Some(0), None, None, Some(order));
        let (predicted_us, submissions) = (None, None);
        Task { pid, lane, name, begin_us, end_us, frame, rows, transfer, bytes, predicted_us, submissions, order }
    }

    /// The upload begins before the download by the clock of another rank, and ends before it in the second case.
    #[test]
    fn arrows_lead_forwards_if_transfers_overlap() {
        for upload_end_us in [410.0, 395.0] {
            assert_leads_forwards(upload_end_us);
        }
    }

    fn assert_leads_forwards(upload_end_us: f64) {
        let [sender, receiver] = [FIRST_DEVICE_PID, FIRST_DEVICE_PID + 1];
        let after = |number, after| Order { number, after };
        let tasks = [
            task(sender, Lane::Left, [0.0, 300.0], after(0, vec![])),
            task(receiver, Lane::Upload, [10.0, upload_end_us], after(0, vec![(sender, 1)])),
            task(sender, Lane::Download, [290.0, 400.0], after(1, vec![(sender, 0)])),
            task(receiver, Lane::Left, [405.0, 700.0], after(1, vec![(receiver, 0)])),
        ];
        let time = FrameTime { frame: 0, begin_us: 0.0, end_us: 800.0, devices: None };
        let frame = Frame { time, tasks: tasks.iter().collect() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace.json");
        let file = TraceFile::start_without_host(&path).unwrap();
        record_transfers(&file.recorder(), &frame);
        record_critical_path(&file.recorder(), &frame);
        file.finish().unwrap();
        let document: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        for (category, pids) in [("transfer", &[sender, receiver][..]), ("critical path", &[10, 10, 11, 11])] {
            let events = document["traceEvents"].as_array().unwrap().iter();
            let arrow: Vec<_> = events.filter(|e| e["cat"] == category).collect();
            let times: Vec<f64> = arrow.iter().map(|e| e["ts"].as_f64().unwrap()).collect();
            assert!(times.is_sorted(), "{category}: {times:?}");
            // The file is sorted by time, so the order of the steps shows the direction.
            assert_eq!(arrow.iter().map(|e| e["pid"].as_u64().unwrap() as u32).collect::<Vec<_>>(), pids, "{category}");
            let steps: Vec<_> = arrow.iter().map(|e| e["ph"].as_str().unwrap()).collect();
            assert_eq!((steps[0], steps[steps.len() - 1]), ("s", "f"), "{category}: {steps:?}");
        }
    }
}
