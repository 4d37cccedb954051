//! Reads a trace file back, checks it, and extracts the work of diptych's devices, frame times, and transfers between
//! ranks.
//!
//! Any Chrome trace is accepted. All other events are only checked for their form.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::path::Path;

use serde_json::{Map, Value};

use super::deadline::DisplayedFrame;
use super::document::raw_trace_from_bytes;
use super::event_fields::{Fields, TrackKey, check_counter, check_finite, whole};
use super::rank_transfers::{HostSpan, rank_transfers};
use super::recorder::RANK_HOST;
use super::work::{Device, FrameTime, Order, Task, Trace};
use super::{FIRST_DEVICE_PID, FRAMES_NAME, HOST_PID, Lane, TraceError};

/// Overlap of consecutive spans that is tolerated, because begin and duration are rounded to f64 microseconds.
const OVERLAP_TOLERANCE_US: f64 = 1e-3;

/// Reads and checks the trace at `path`.
///
/// # Errors
/// [`TraceError::Read`], [`TraceError::NotATrace`] or, naming the event, [`TraceError::Event`].
pub fn read(path: &Path) -> Result<Trace, TraceError> {
    let name = path.display().to_string();
    match std::fs::read(path) {
        Ok(bytes) => parse(&bytes, &name),
        Err(source) => Err(TraceError::Read { path: name, source }),
    }
}

/// Parses a trace from memory like [`read`]; `origin` names it in messages.
pub fn parse(bytes: &[u8], origin: &str) -> Result<Trace, TraceError> {
    let not_a_trace = |what: String| TraceError::NotATrace { path: origin.to_owned(), what };
    let raw = raw_trace_from_bytes(bytes).map_err(not_a_trace)?;
    let mut reader = Reader { is_cut: raw.is_cut, ..Reader::default() };
    let residual_us = |pid: u32| {
        let note = format!("clock_residual_us.device_{}", pid.checked_sub(FIRST_DEVICE_PID)?);
        raw.other_data[&note].as_f64()
    };
    let checked = reader.all(raw.events, &residual_us);
    let mut trace = checked.map_err(|(index, what)| TraceError::Event { path: origin.to_owned(), index, what })?;
    for (&pid, device) in &mut trace.devices {
        device.clock_residual_us = residual_us(pid);
    }
    if raw.is_cut || raw.other_data["complete"] == Value::Bool(false) {
        trace.warnings.push("the run ended early: later events are missing".to_owned());
    }
    Ok(trace)
}

/// Index of a faulty event, with a description of the fault.
type Wrong = (usize, String);

struct Span {
    index: usize,
    track: TrackKey,
    name: String,
    begin_us: f64,
    end_us: f64,
    args: Value,
}

/// A `B` or an `E` event.
struct Edge {
    index: usize,
    time_us: f64,
    is_begin: bool,
}

#[derive(Default)]
struct Reader {
    process_names: HashMap<String, String>,
    thread_names: HashMap<TrackKey, String>,
    spans: Vec<Span>,
    edges: BTreeMap<TrackKey, Vec<Edge>>,
    flow_starts: HashSet<String>,
    flow_ends: HashSet<String>,
    unknown_phases: BTreeMap<String, usize>,
    is_cut: bool,
}

impl Reader {
    /// Processes all events. `residual_us` returns the maximum error of a device's times, if known.
    fn all(&mut self, events: Vec<Value>, residual_us: &dyn Fn(u32) -> Option<f64>) -> Result<Trace, Wrong> {
        for (index, event) in events.into_iter().enumerate() {
            let Value::Object(event) = event else {
                return Err((index, "it is no object".to_owned()));
            };
            self.event(index, event).map_err(|what| (index, what))?;
        }
        self.check_balance()?;
        let spans = std::mem::take(&mut self.spans);
        let (mut device_spans, mut frame_times, mut foreign_pids) = (Vec::new(), Vec::new(), BTreeSet::new());
        let (mut host_spans, mut deadlines) = (Vec::new(), Vec::new());
        for span in spans {
            if let Some(lane) = self.device_lane(&span.track) {
                device_spans.push((lane, span));
            } else if self.is_of_frames(&span.track) {
                match span.name.as_str() {
                    "frame" => frame_times.extend(frame_time(&span).map_err(|what| (span.index, what))?),
                    _ => deadlines.extend(displayed(&span).map_err(|what| (span.index, what))?),
                }
            } else if self.is_host(&span.track.0) {
                let Span { name, begin_us, end_us, args, .. } = span;
                host_spans.push(HostSpan { name, begin_us, end_us, args });
            } else {
                foreign_pids.insert(span.track.0);
            }
        }
        let warnings = self.warnings(&foreign_pids);
        let passages = rank_transfers(host_spans);
        let (devices, tasks) = (self.devices(), tasks(device_spans, residual_us)?);
        Ok(Trace { devices, tasks, frame_times, deadlines, passages, warnings })
    }

    fn event(&mut self, index: usize, mut event: Map<String, Value>) -> Result<(), String> {
        let args = event.remove("args").unwrap_or(Value::Null);
        let fields = Fields(&event);
        let phase = fields.text("ph")?;
        match phase {
            "M" => self.metadata(&fields, &args)?,
            "X" => {
                let (track, begin_us) = (fields.track()?, fields.number("ts")?);
                let duration_us = fields.number("dur")?;
                if duration_us < 0.0 {
                    return Err(format!("its \"dur\" is {duration_us}, below 0"));
                }
                self.spans.push(Span {
                    index,
                    track,
                    name: fields.text("name").unwrap_or_default().to_owned(),
                    begin_us,
                    end_us: begin_us + duration_us,
                    args,
                });
            }
            "B" | "E" => {
                let time_us = fields.number("ts")?;
                let is_begin = phase == "B";
                let edges = self.edges.entry(fields.track()?).or_default();
                edges.push(Edge { index, time_us, is_begin });
            }
            "C" => {
                fields.id("pid")?;
                fields.number("ts")?;
                check_counter(&args)?;
            }
            "i" | "I" | "R" => fields.instant()?,
            "s" | "t" | "f" => {
                fields.track()?;
                fields.number("ts")?;
                let id = fields.id("id").or_else(|_| fields.id2())?;
                match phase {
                    "s" => drop(self.flow_starts.insert(id)),
                    _ => drop(self.flow_ends.insert(id)),
                }
            }
            "b" | "n" | "e" | "S" | "T" | "p" | "F" => {
                fields.id("pid")?;
                fields.number("ts")?;
                fields.id("id").or_else(|_| fields.id2())?;
            }
            other => *self.unknown_phases.entry(other.to_owned()).or_default() += 1,
        }
        Ok(())
    }

    fn metadata(&mut self, fields: &Fields, args: &Value) -> Result<(), String> {
        let name = fields.text("name")?;
        let shown = args["name"].as_str().unwrap_or_default().to_owned();
        match name {
            "process_name" => drop(self.process_names.insert(fields.id("pid")?, shown)),
            "thread_name" => drop(self.thread_names.insert(fields.track()?, shown)),
            _ => {}
        }
        Ok(())
    }

    fn check_balance(&mut self) -> Result<(), Wrong> {
        for edges in self.edges.values_mut() {
            edges.sort_by(|a, b| a.time_us.total_cmp(&b.time_us));
            let mut open = Vec::new();
            for edge in edges {
                if edge.is_begin {
                    open.push(edge.index);
                } else if open.pop().is_none() {
                    return Err((edge.index, "it ends a span that never began".to_owned()));
                }
            }
            if let Some(index) = open.pop().filter(|_| !self.is_cut) {
                return Err((index, "the span it begins never ends".to_owned()));
            }
        }
        Ok(())
    }

    /// Returns the process and the lane of a device's track; `None` for other tracks. On a device's track, the process
    /// number is at least [`FIRST_DEVICE_PID`], and the thread is named like a lane.
    fn device_lane(&self, track: &TrackKey) -> Option<(u32, Lane)> {
        let pid: u32 = track.0.parse().ok().filter(|&pid| pid >= FIRST_DEVICE_PID)?;
        let name = self.thread_names.get(track)?;
        let lane = Lane::ALL.into_iter().find(|lane| lane.name() == name)?;
        Some((pid, lane))
    }

    /// Returns true if the threads of this process belong to a rank.
    fn is_host(&self, pid: &str) -> bool {
        pid == HOST_PID.to_string() || self.process_names.get(pid).is_some_and(|name| name.starts_with(RANK_HOST))
    }

    /// Returns true for tracks of frames: `frames`, `frames 2` and so on.
    fn is_of_frames(&self, track: &TrackKey) -> bool {
        track.0 == HOST_PID.to_string()
            && self.thread_names.get(track).is_some_and(|name| name.starts_with(FRAMES_NAME))
    }

    fn devices(&self) -> BTreeMap<u32, Device> {
        let tracks = self.thread_names.keys();
        tracks
            .filter_map(|track| {
                let (pid, _) = self.device_lane(track)?;
                let name = self.process_names.get(&track.0).cloned();
                let name = name.unwrap_or_else(|| format!("process {pid}"));
                Some((pid, Device { name, clock_residual_us: None }))
            })
            .collect()
    }

    fn warnings(&self, foreign_pids: &BTreeSet<String>) -> Vec<String> {
        let mut warnings = Vec::new();
        if !foreign_pids.is_empty() {
            let pids = foreign_pids.iter().cloned().collect::<Vec<_>>().join(", ");
            warnings.push(format!("spans outside of device lanes are left out: process {pids}"));
        }
        for (phase, count) in &self.unknown_phases {
            warnings.push(format!("{count} events of unknown phase '{phase}' are left out"));
        }
        let orphans = self.flow_ends.difference(&self.flow_starts).count();
        if orphans > 0 {
            warnings.push(format!("{orphans} arrows end but never start"));
        }
        let loose = self.flow_starts.difference(&self.flow_ends).count();
        if loose > 0 {
            warnings.push(format!("{loose} arrows start but never end"));
        }
        warnings
    }
}

/// Converts device spans to tasks, sorted by begin time. Fails if two tasks on one lane overlap by more than twice the
/// residual of their device's clock. Smaller overlaps are possible, because the times of each frame are converted to
/// the host's clock separately, with an error of up to the residual.
fn tasks(mut spans: Vec<((u32, Lane), Span)>, residual_us: &dyn Fn(u32) -> Option<f64>) -> Result<Vec<Task>, Wrong> {
    spans.sort_by(|(_, a), (_, b)| a.begin_us.total_cmp(&b.begin_us).then(a.end_us.total_cmp(&b.end_us)));
    let mut last_on_lane: HashMap<(u32, Lane), (usize, f64)> = HashMap::new();
    let mut tasks = Vec::with_capacity(spans.len());
    for ((pid, lane), span) in spans {
        let last = last_on_lane.insert((pid, lane), (span.index, span.end_us));
        let tolerance_us = OVERLAP_TOLERANCE_US + 2.0 * residual_us(pid).filter(|us| *us > 0.0).unwrap_or(0.0);
        if let Some((other, end_us)) = last.filter(|l| span.begin_us < l.1 - tolerance_us) {
            let (name, begin_us) = (&span.name, span.begin_us);
            let what = format!(
                "task '{name}' begins at {begin_us} µs, before event {other} on the same lane ends at {end_us} µs"
            );
            return Err((span.index, what));
        }
        tasks.push(task(pid, lane, span)?);
    }
    Ok(tasks)
}

fn task(pid: u32, lane: Lane, span: Span) -> Result<Task, Wrong> {
    let wrong = |what| (span.index, what);
    check_finite(&span.args).map_err(wrong)?;
    let whole = |name| whole(&span.args, name).map_err(wrong);
    let rows = whole("row_begin")?.zip(whole("rows")?);
    Ok(Task {
        pid,
        lane,
        begin_us: span.begin_us,
        end_us: span.end_us,
        frame: whole("frame")?,
        rows: rows.map(|(begin, count)| begin..begin.saturating_add(count)),
        transfer: whole("transfer")?,
        bytes: whole("bytes")?,
        predicted_us: span.args["predicted_ms"].as_f64().map(|ms| ms * 1e3),
        submissions: whole("submissions")?,
        order: order(&span.args).map_err(wrong)?,
        name: span.name,
    })
}

/// Returns a task's position in its frame's graph, if the arguments give it: `task` is the task's number, and `after`
/// lists its dependencies by device and number, as in `0.3 1.7`.
fn order(args: &Value) -> Result<Option<Order>, String> {
    let Some(number) = whole(args, "task")? else { return Ok(None) };
    let after = args["after"].as_str().unwrap_or_default();
    let place = |text: &str| {
        let (device, number) = text.split_once('.')?;
        Some((FIRST_DEVICE_PID.checked_add(device.parse().ok()?)?, number.parse().ok()?))
    };
    let after = after.split_whitespace().map(place).collect::<Option<Vec<_>>>();
    let after = after.ok_or_else(|| "its argument 'after' is not a list of tasks".to_owned())?;
    Ok(Some(Order { number, after }))
}

/// Returns the time of the frame that `span` records; `None` if the span has no frame number.
fn frame_time(span: &Span) -> Result<Option<FrameTime>, String> {
    let devices = devices(&span.args)?;
    let frame = whole(&span.args, "frame")?;
    Ok(frame.map(|frame| FrameTime { frame, begin_us: span.begin_us, end_us: span.end_us, devices }))
}

/// Returns the frame on a display that `span` records; `None` if the span is another.
fn displayed(span: &Span) -> Result<Option<DisplayedFrame>, String> {
    if span.args.get("over_deadline_ms").is_none() {
        return Ok(None);
    }
    check_finite(&span.args)?;
    let known = |name: &str| span.args[name].as_f64();
    let ms = |name: &str| known(name).ok_or_else(|| format!("it needs a number '{name}' beside 'over_deadline_ms'"));
    let whole = |name| whole(&span.args, name);
    let text = |name: &str| span.args[name].as_str().map(ToOwned::to_owned);
    Ok(Some(DisplayedFrame {
        frame: whole("frame")?.ok_or("it needs a number 'frame' beside 'over_deadline_ms'")?,
        over_deadline_ms: ms("over_deadline_ms")?,
        period_ms: ms("period_ms")?,
        whole_ms: ms("whole_ms")?,
        host_before_ms: ms("host_before_ms")?,
        makespan_ms: ms("makespan_ms")?,
        host_after_ms: ms("host_after_ms")?,
        missed_periods: whole("missed_periods")?.unwrap_or(0),
        rung: whole("rung")?,
        expected_ms: known("expected_ms"),
        others_share: known("others_share"),
        disturbance: text("disturbance"),
        cause: text("cause"),
    }))
}

/// Returns the devices of a frame as a bit mask. The argument `devices` lists their numbers, as in `0,2`. Older traces
/// store a count n instead, which stands for devices 0 to n − 1.
fn devices(args: &Value) -> Result<Option<u64>, String> {
    let Value::String(numbers) = &args["devices"] else {
        let count = whole(args, "devices")?;
        return Ok(count.map(|count| u64::MAX.checked_shr(64 - count.clamp(0, 64) as u32).unwrap_or(0)));
    };
    let bits = numbers.split(',').map(|n| n.parse().ok().and_then(|device| 1u64.checked_shl(device)));
    let devices = bits.collect::<Option<Vec<_>>>().map(|bits| bits.into_iter().fold(0, |all, bit| all | bit));
    devices.map(Some).ok_or_else(|| format!("its argument 'devices' is '{numbers}', not a list of devices"))
}
