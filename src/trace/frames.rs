//! Frames in a trace: stage tasks and transfers on their devices' lanes, arrows between the two ends of a transfer, and
//! counters.

use std::collections::HashMap;

use super::{HOST_PID, Lane, Recorder};
use crate::exec::{Fault, FrameReport, TaskTiming, TimedTask};
use crate::graph::Stage;
use crate::scene::rig::Eye;

/// What a frame's counters show beside its times.
#[derive(Clone, Copy, Debug)]
pub struct FrameKnobs {
    pub spp: u32,
    pub iterations: u32,
    /// Lower and upper bound of the makespan aimed at.
    pub budget_ms: [f64; 2],
}

/// Adds a frame. The recorder's origin must be the renderer's.
pub fn record_frame(recorder: &Recorder, frame: &FrameReport, knobs: &FrameKnobs) {
    if !recorder.is_on() {
        return;
    }
    for task in &frame.tasks {
        record_task(recorder, task, frame.index, knobs);
    }
    record_flows(recorder, frame);
    let at_us = frame.begin_ms * 1e3;
    let [low, high] = knobs.budget_ms;
    recorder.counter(
        "frame time (ms)",
        at_us,
        &[("makespan", frame.makespan_ms), ("budget low", low), ("budget high", high)],
    );
    recorder.counter("spp", at_us, &[("spp", f64::from(knobs.spp))]);
    recorder.counter("iterations", at_us, &[("iterations", f64::from(knobs.iterations))]);
    recorder.counter("bytes moved", at_us, &[("bytes", frame.uploaded_bytes() as f64)]);
    let stripes = frame.assignment.stripes(Stage::PathTrace, Eye::Left);
    let shares: Vec<(String, f64)> = (0..stripes.devices())
        .map(|d| (format!("device {d}"), stripes.rows(d).len() as f64 / f64::from(stripes.height())))
        .collect();
    let shares: Vec<(&str, f64)> = shares.iter().map(|(n, s)| (n.as_str(), *s)).collect();
    recorder.counter("share of rows", at_us, &shares);
}

fn lane(task: &TaskTiming) -> Lane {
    match (task.kind, task.view) {
        (TimedTask::Download, _) => Lane::Download,
        (TimedTask::Upload, _) => Lane::Upload,
        (TimedTask::Gpu(_), Eye::Left) => Lane::Left,
        (TimedTask::Gpu(_), Eye::Right) => Lane::Right,
    }
}

fn record_task(recorder: &Recorder, task: &TaskTiming, frame: u32, knobs: &FrameKnobs) {
    let mut args = vec![
        ("frame", f64::from(frame)),
        ("row_begin", f64::from(task.rows.start)),
        ("rows", task.rows.len() as f64),
        ("spp", f64::from(knobs.spp)),
    ];
    if let Some(bytes) = task.bytes {
        args.push(("bytes", bytes as f64));
    }
    let (begin, end) = (task.begin_ms * 1e3, task.end_ms * 1e3);
    recorder.task(task.device as u32, lane(task), task.stage, begin, end, &args);
}

/// One arrow per transfer, from where the rows left to where they arrived.
fn record_flows(recorder: &Recorder, frame: &FrameReport) {
    let sent: HashMap<u32, &TaskTiming> =
        frame.tasks.iter().filter(|t| t.kind == TimedTask::Download).filter_map(|t| Some((t.transfer?, t))).collect();
    for task in frame.tasks.iter().filter(|t| t.kind == TimedTask::Upload) {
        let Some((transfer, from)) = task.transfer.and_then(|t| Some((t, sent.get(&t)?))) else { continue };
        let middle = |t: &TaskTiming| 0.5e3 * (t.begin_ms + t.end_ms);
        let id = u64::from(frame.index) << 32 | u64::from(transfer);
        let end = |t: &TaskTiming| (lane(t).track(t.device as u32), middle(t));
        recorder.flow(id, task.stage, end(from), end(task));
    }
}

/// Marks where a device was taken out.
pub fn record_fault(recorder: &Recorder, fault: &Fault) {
    let frame = fault.frame.to_string();
    let args = [("frame", frame.as_str()), ("what", &fault.what)];
    recorder.mark(fault.device as u32, Lane::Both, "device taken out", fault.noticed_ms * 1e3, &args);
}

/// Names the devices of a run and tells how far their clocks can be trusted.
pub fn record_devices(recorder: &Recorder, devices: &[crate::device::DeviceInfo]) {
    for device in devices {
        recorder.device(device.index as u32, &format!("device {}: {}", device.index, device.name));
        recorder.note(&format!("clock_residual_us.device_{}", device.index), device.clock_residual_us);
    }
    recorder.note("host_pid", HOST_PID);
}
