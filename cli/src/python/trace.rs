//! Traces, for charts in Python.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use serde::Serialize;

use super::failure::exception;
use crate::failure::Failure;
use diptych::trace::Lane;
use diptych::trace::read::read;
use diptych::trace::summary::Summary;

/// A trace as Python sees it. Times are in milliseconds since the first frame began.
#[derive(Serialize)]
struct TraceRow<'a> {
    devices: Vec<DeviceRow<'a>>,
    frames: Vec<FrameRow>,
    tasks: Vec<TaskRow<'a>>,
    summary: Summary,
}

#[derive(Serialize)]
struct DeviceRow<'a> {
    pid: u32,
    name: &'a str,
}

#[derive(Serialize)]
struct FrameRow {
    frame: u64,
    begin_ms: f64,
    end_ms: f64,
}

#[derive(Serialize)]
struct TaskRow<'a> {
    pid: u32,
    lane: Lane,
    name: &'a str,
    frame: Option<u64>,
    begin_ms: f64,
    end_ms: f64,
    /// The first row, and the one after the last.
    rows: Option<[u64; 2]>,
    bytes: Option<u64>,
}

/// Reads a trace file: its devices, frames and tasks, and the summary of `diptych trace`, in JSON.
#[pyfunction]
pub fn read_trace(py: Python<'_>, path: PathBuf) -> PyResult<String> {
    py.detach(|| text(&path).map_err(exception))
}

fn text(path: &Path) -> Result<String, Failure> {
    let trace = read(path)?;
    let frames = trace.frames();
    let first_us = frames.iter().map(|frame| frame.time.begin_us).reduce(f64::min);
    let zero_us = first_us.or(trace.tasks.first().map(|task| task.begin_us)).unwrap_or(0.0);
    let ms = |us: f64| (us - zero_us) / 1e3;
    let row = TraceRow {
        devices: trace.devices.iter().map(|(&pid, device)| DeviceRow { pid, name: &device.name }).collect(),
        frames: frames
            .iter()
            .map(|frame| {
                let time = &frame.time;
                FrameRow { frame: time.frame, begin_ms: ms(time.begin_us), end_ms: ms(time.end_us) }
            })
            .collect(),
        tasks: trace
            .tasks
            .iter()
            .map(|task| TaskRow {
                pid: task.pid,
                lane: task.lane,
                name: &task.name,
                frame: task.frame,
                begin_ms: ms(task.begin_us),
                end_ms: ms(task.end_us),
                rows: task.rows.as_ref().map(|rows| [rows.start, rows.end]),
                bytes: task.bytes,
            })
            .collect(),
        summary: Summary::of(&trace),
    };
    Ok(serde_json::to_string(&row).map_err(anyhow::Error::from)?)
}
