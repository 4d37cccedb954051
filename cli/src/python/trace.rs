//! Traces, for charts in Python.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use serde_json::json;

use super::failure::exception;
use crate::failure::Failure;
use diptych::trace::read::read;
use diptych::trace::summary::Summary;

/// Reads a trace file: its devices, frames and tasks, and the summary of `diptych trace`, in JSON. Times are in
/// milliseconds since the first frame began. `rows` are the first row of a task, and the one after the last.
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
    let devices = trace.devices.iter().map(|(pid, device)| json!({ "pid": pid, "name": device.name }));
    let frames = frames.iter().map(|frame| {
        json!({ "frame": frame.time.frame, "begin_ms": ms(frame.time.begin_us), "end_ms": ms(frame.time.end_us) })
    });
    let tasks = trace.tasks.iter().map(|task| {
        json!({
            "pid": task.pid, "lane": task.lane, "name": task.name, "frame": task.frame, "bytes": task.bytes,
            "begin_ms": ms(task.begin_us), "end_ms": ms(task.end_us),
            "rows": task.rows.as_ref().map(|rows| [rows.start, rows.end]),
        })
    });
    let row = json!({
        "devices": devices.collect::<Vec<_>>(), "frames": frames.collect::<Vec<_>>(),
        "tasks": tasks.collect::<Vec<_>>(), "summary": Summary::of(&trace),
    });
    Ok(row.to_string())
}
