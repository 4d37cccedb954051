//! Where time went: host spans, device lanes, counters and arrows in one Chrome trace, and reading it back.
//!
//! A [`TraceFile`] owns the file of a run, its [`Recorder`]s are handed to whoever has times to tell. All times
//! are microseconds after [`Recorder::origin`].

pub mod event;
pub mod frames;
mod host;
mod intervals;
pub mod read;
pub mod summary;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::image::ImageError;
use crate::image::file::atomic_write;
use event::{Event, FlowStep, Kind, Track, args_from};
use host::HostSpans;

/// Process of host spans and of counters.
pub const HOST_PID: u32 = 1;
/// Device `i` is process `FIRST_DEVICE_PID + i`.
pub const FIRST_DEVICE_PID: u32 = 10;

#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    #[error("host spans cannot be recorded: this process has a tracing subscriber already")]
    SubscriberTaken,
    #[error("the host spans that were recorded cannot be read: {0}")]
    HostSpans(String),
    #[error(transparent)]
    Write(#[from] ImageError),
    #[error("cannot read trace '{path}'")]
    Read { path: String, source: std::io::Error },
    #[error("'{path}' is not a trace: {what}")]
    NotATrace { path: String, what: String },
    #[error("'{path}', event {index} (counted from 0): {what}")]
    Event { path: String, index: usize, what: String },
}

/// What a device does side by side: work on one eye, on both, and transfers from and to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Lane {
    Left,
    Right,
    Both,
    Upload,
    Download,
}

impl Lane {
    pub const ALL: [Lane; 5] = [Lane::Left, Lane::Right, Lane::Both, Lane::Upload, Lane::Download];

    pub fn name(self) -> &'static str {
        match self {
            Lane::Left => "left",
            Lane::Right => "right",
            Lane::Both => "both",
            Lane::Upload => "upload",
            Lane::Download => "download",
        }
    }

    pub fn is_transfer(self) -> bool {
        matches!(self, Lane::Upload | Lane::Download)
    }

    /// Where the lane of device `device` is shown.
    pub fn track(self, device: u32) -> Track {
        Track { pid: FIRST_DEVICE_PID + device, tid: self as u32 + 1 }
    }
}

/// Takes down device times, counters and arrows; clones write to the same trace, from any thread.
#[derive(Clone)]
pub struct Recorder {
    origin: Instant,
    log: Option<Arc<Mutex<Log>>>,
}

#[derive(Default)]
struct Log {
    events: Vec<Event>,
    notes: Map<String, Value>,
    /// Events whose times were not finite or ran backwards.
    dropped_events: u64,
}

impl Recorder {
    /// A recorder that takes nothing down.
    pub fn off() -> Recorder {
        Recorder { origin: Instant::now(), log: None }
    }

    pub fn is_on(&self) -> bool {
        self.log.is_some()
    }

    /// Zero of all times.
    pub fn origin(&self) -> Instant {
        self.origin
    }

    /// Microseconds from the origin to `instant`, negative before it.
    pub fn time_us(&self, instant: Instant) -> f64 {
        match instant.checked_duration_since(self.origin) {
            Some(after) => after.as_nanos() as f64 / 1000.0,
            None => -((self.origin - instant).as_nanos() as f64 / 1000.0),
        }
    }

    /// Names device `device` and its lanes.
    pub fn device(&self, device: u32, name: &str) {
        let pid = FIRST_DEVICE_PID + device;
        self.push(|| {
            let lanes = Lane::ALL.into_iter().flat_map(|lane| {
                let track = lane.track(device);
                [Event::thread_name(track, lane.name()), Event::thread_sort_index(track, track.tid)]
            });
            let process = [Event::process_name(pid, name), Event::process_sort_index(pid, pid)];
            process.into_iter().chain(lanes)
        });
    }

    /// Work on one lane of a device, from GPU timestamps brought to the origin.
    pub fn task(&self, device: u32, lane: Lane, name: &str, begin_us: f64, end_us: f64, args: &[(&str, f64)]) {
        self.push(|| {
            [Event {
                kind: Kind::Complete { duration_us: end_us - begin_us },
                name: name.to_owned(),
                category: if lane.is_transfer() { "transfer" } else { "device" },
                track: lane.track(device),
                time_us: begin_us,
                args: args_from(args),
            }]
        });
    }

    /// A moment on one lane of a device, with what there is to say about it.
    pub fn mark(&self, device: u32, lane: Lane, name: &str, time_us: f64, args: &[(&str, &str)]) {
        self.push(|| {
            let args = args.iter().map(|&(name, text)| (name.to_owned(), text.into())).collect();
            let track = lane.track(device);
            [Event { kind: Kind::Instant, name: name.to_owned(), category: "device", track, time_us, args }]
        });
    }

    /// The values of counter `name` from `time_us` on, each a series of its own.
    pub fn counter(&self, name: &str, time_us: f64, values: &[(&str, f64)]) {
        self.push(|| {
            [Event {
                kind: Kind::Counter,
                name: name.to_owned(),
                category: "counter",
                track: Track { pid: HOST_PID, tid: 0 },
                time_us,
                args: args_from(values),
            }]
        });
    }

    /// An arrow from the span around one time to the span around another. `id` is unique to the arrow.
    pub fn flow(&self, id: u64, name: &str, from: (Track, f64), to: (Track, f64)) {
        self.push(|| {
            [(FlowStep::Start, from), (FlowStep::Finish, to)].map(|(step, (track, time_us))| {
                let kind = Kind::Flow { step, id };
                Event { kind, name: name.to_owned(), category: "flow", track, time_us, args: Default::default() }
            })
        });
    }

    /// Something about the whole run, such as the residual of a device's clock; lands in `otherData`.
    pub fn note(&self, key: &str, value: impl Into<Value>) {
        if let Some(mut log) = self.lock() {
            log.notes.insert(key.to_owned(), value.into());
        }
    }

    fn push<E: IntoIterator<Item = Event>>(&self, events: impl FnOnce() -> E) {
        let Some(mut log) = self.lock() else { return };
        for event in events() {
            if has_sane_times(&event) {
                log.events.push(event);
            } else {
                log.dropped_events += 1;
            }
        }
    }

    fn lock(&self) -> Option<MutexGuard<'_, Log>> {
        let log = self.log.as_ref()?;
        Some(log.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

fn has_sane_times(event: &Event) -> bool {
    let duration_us = match event.kind {
        Kind::Complete { duration_us } => duration_us,
        _ => 0.0,
    };
    event.time_us.is_finite() && duration_us.is_finite() && duration_us >= 0.0
}

/// The trace-file of a run. Written by [`TraceFile::finish`], or, with what is known by then, when it is dropped
/// because the run failed or panicked. (`std::process::exit` drops nothing: call it after this is gone.)
pub struct TraceFile {
    path: PathBuf,
    recorder: Recorder,
    /// `None` once written, and where host spans are not wanted.
    host: Option<HostSpans>,
    is_written: bool,
}

impl TraceFile {
    /// Starts recording device lanes and this process's `tracing` spans. Nothing is written yet.
    ///
    /// # Errors
    /// [`TraceError::SubscriberTaken`]: host spans can be recorded once in a process's life.
    pub fn start(path: &Path) -> Result<TraceFile, TraceError> {
        let origin = Instant::now();
        let host = HostSpans::install(origin)?;
        Ok(TraceFile::new(path, origin, Some(host)))
    }

    /// As [`TraceFile::start`], but without host spans.
    pub fn start_without_host(path: &Path) -> TraceFile {
        TraceFile::new(path, Instant::now(), None)
    }

    fn new(path: &Path, origin: Instant, host: Option<HostSpans>) -> TraceFile {
        let log = Some(Arc::new(Mutex::new(Log::default())));
        TraceFile { path: path.to_owned(), recorder: Recorder { origin, log }, host, is_written: false }
    }

    pub fn recorder(&self) -> Recorder {
        self.recorder.clone()
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`TraceError::Write`], [`TraceError::HostSpans`]; of the two the second still leaves a valid file.
    pub fn finish(mut self) -> Result<(), TraceError> {
        self.write(true)
    }

    fn write(&mut self, is_complete: bool) -> Result<(), TraceError> {
        self.is_written = true;
        let log = self.recorder.lock().map(|mut log| std::mem::take(&mut *log));
        let mut log = log.unwrap_or_default();
        let host = self.host.take().map(HostSpans::collect).transpose();
        let host_result = host.map(|host| {
            if let Some(host) = host {
                log.notes.insert("host_clock_residual_us".to_owned(), host.clock_residual_us.into());
                log.events.extend(host.events);
            }
        });
        log.notes.insert("complete".to_owned(), is_complete.into());
        log.notes.insert("dropped_events".to_owned(), log.dropped_events.into());
        log.notes.insert("writer".to_owned(), concat!("diptych ", env!("CARGO_PKG_VERSION")).into());
        write_events(&self.path, log)?;
        host_result
    }
}

impl Drop for TraceFile {
    fn drop(&mut self) {
        if !self.is_written
            && let Err(error) = self.write(false)
        {
            eprintln!("trace: {error}");
        }
    }
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    trace_events: Vec<Event>,
    display_time_unit: &'static str,
    other_data: Map<String, Value>,
}

fn write_events(path: &Path, log: Log) -> Result<(), TraceError> {
    let mut events = log.events;
    let key = |event: &Event| (event.kind != Kind::Metadata, event.time_us);
    events.sort_by(|a, b| {
        let ((a_timed, a_us), (b_timed, b_us)) = (key(a), key(b));
        a_timed.cmp(&b_timed).then(a_us.total_cmp(&b_us))
    });
    let document = Document { trace_events: events, display_time_unit: "ms", other_data: log.notes };
    atomic_write(path, |file| Ok(serde_json::to_writer(file, &document)?))?;
    Ok(())
}

#[cfg(test)]
mod tests;
