//! Records device times, host spans, counters and arrows.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use serde_json::{Map, Value};

use super::deadline::{Deadline, Presented};
use super::event::{Args, Event, FlowStep, Kind, Track, args_from};
use super::growing::GrowingDocument;
use super::host::{HostSpans, Spans};
use super::{
    DEADLINES_NAME, DEADLINES_TRACK, FIRST_DEVICE_PID, FIRST_RANK_PID, FRAMES_NAME, FRAMES_TRACK, FRAMES_TRACKS,
    HOST_PID, Lane, TraceError,
};

/// Prefix of the names of other ranks' processes. The number of the rank follows.
pub(super) const RANK_HOST: &str = "host of rank ";

/// Maximum number of missed periods that a frame marks; after a long pause there may be thousands.
const MISSED_MAX: u32 = 100;

/// Handle for writing to the trace of a run from any thread. Clones write to the same trace.
#[derive(Clone)]
pub struct Recorder {
    origin: Instant,
    log: Option<Arc<Mutex<Log>>>,
}

/// The file, and events that are not written yet.
#[derive(Default)]
pub(super) struct Log {
    /// Document that the file holds. It is `None` before the trace begins and after it ends; then nothing is recorded.
    document: Option<GrowingDocument>,
    events: Vec<Event>,
    host: Option<HostSpans>,
    /// Host spans of this process and of other ranks, by process.
    spans: BTreeMap<u32, Spans>,
    notes: Map<String, Value>,
    /// Tracks of frames and deadlines that have names.
    named: BTreeSet<Track>,
    /// Number of dropped events, whose times were not finite or ran backwards.
    dropped_events: u64,
    /// First write error; no write was attempted after it.
    failure: Option<TraceError>,
}

impl Recorder {
    /// Creates a recorder that records nothing.
    pub fn off() -> Recorder {
        Recorder { origin: Instant::now(), log: None }
    }

    /// Creates a recorder that records nothing until [`Self::open`] gives it a document.
    pub(super) fn new() -> Recorder {
        Recorder { origin: Instant::now(), log: Some(Arc::default()) }
    }

    /// Begins the trace, with host spans if they are recorded.
    pub(super) fn open(&self, document: GrowingDocument, host: Option<HostSpans>) {
        let Some(mut log) = self.lock() else { return };
        (log.document, log.host) = (Some(document), host);
        log.extend(Event::process(HOST_PID, "host"));
        log.write(false);
    }

    pub fn is_on(&self) -> bool {
        self.log.is_some()
    }

    /// Returns the origin of all times.
    pub fn origin(&self) -> Instant {
        self.origin
    }

    /// Returns microseconds from the origin to `instant`, negative before it.
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
            let lanes = Lane::ALL.into_iter().flat_map(|lane| Event::thread(lane.track(device), lane.name()));
            Event::process(pid, name).into_iter().chain(lanes)
        });
    }

    /// Records work on one lane of a device. Times are microseconds since the origin; GPU timestamps must
    /// be converted first.
    pub fn task(&self, device: u32, lane: Lane, name: &str, [begin_us, end_us]: [f64; 2], args: Args) {
        let category = if lane.is_transfer() { "transfer" } else { "device" };
        self.span(lane.track(device), category, name, begin_us, end_us, args);
    }

    /// Records spans of another rank's process from the text of its [`HostSpans`]. The times in the text count from
    /// `zero_us`, which is a time of this recorder.
    pub fn rank_host(&self, rank: u32, machine: &str, zero_us: f64, text: &[u8]) {
        let Some(mut log) = self.lock() else { return };
        let pid = FIRST_RANK_PID.saturating_add(rank);
        if !log.spans.contains_key(&pid) {
            log.extend(Event::process(pid, &format!("{RANK_HOST}{rank} on {machine}")));
        }
        log.push_spans(pid, zero_us, text);
    }

    /// Records a frame on the host's frame track number `slot`: frames in flight overlap, so each slot has a track of
    /// its own. `args` should hold the frame's number as `frame`.
    pub fn frame(&self, slot: usize, begin_us: f64, end_us: f64, args: Args) {
        self.span(self.frames_track(slot), "frame", "frame", begin_us, end_us, args);
    }

    /// Records a frame on a display: the time that it had, its deadline and the refreshes that it missed on a track of
    /// their own, and around its [`Self::frame`] its whole time, with the host time before and after the frame. The name
    /// of a late frame tells how late it was and why.
    pub(super) fn presented(
        &self,
        slot: usize,
        [begin_us, end_us]: [f64; 2],
        frame: u32,
        shown: &Presented,
        args: Args,
    ) {
        let Presented { deadline, cause, .. } = shown;
        let Deadline { refresh_ms, started_ms, complete_ms, due_ms, missed_periods } = *deadline;
        let name = cause.as_ref().map_or_else(
            || format!("frame {frame}"),
            |cause| format!("frame {frame}, late {:.1} ms: {cause}", deadline.over_ms()),
        );
        let (track, had) = (self.frames_track(slot), self.track(DEADLINES_TRACK, DEADLINES_NAME.to_owned()));
        let [started_us, complete_us] = [started_ms * 1e3, complete_ms * 1e3];
        self.span(track, "frame", &name, started_us, complete_us.max(end_us), args.clone());
        self.span(track, "host", "before the frame", started_us, begin_us, Args::new());
        self.span(track, "host", "after the frame", end_us, complete_us, Args::new());
        self.span(had, "deadline", &format!("frame {frame}"), refresh_ms * 1e3, due_ms * 1e3, args);
        self.instant(had, "deadline", due_ms * 1e3);
        for period in 0..missed_periods.min(MISSED_MAX) {
            let at_ms = due_ms + deadline.period_ms() * f64::from(period);
            self.instant(had, &format!("frame {frame} late: missed period"), at_ms * 1e3);
        }
    }

    fn instant(&self, track: Track, name: &str, time_us: f64) {
        let (name, args) = (name.to_owned(), Args::new());
        self.push(|| [Event { kind: Kind::Instant, name, category: "deadline", track, time_us, args }]);
    }

    /// Returns the track of a slot, with a name.
    fn frames_track(&self, slot: usize) -> Track {
        let number = slot as u32 % FRAMES_TRACKS;
        let name = if number == 0 { FRAMES_NAME.to_owned() } else { format!("{FRAMES_NAME} {}", number + 1) };
        self.track(Track { tid: FRAMES_TRACK.tid + number, ..FRAMES_TRACK }, name)
    }

    /// Names a track of the host on its first use, so that unused tracks do not appear.
    fn track(&self, track: Track, name: String) -> Track {
        if let Some(mut log) = self.lock().filter(|log| !log.named.contains(&track)) {
            log.named.insert(track);
            log.extend(Event::thread(track, &name));
        }
        track
    }

    fn span(&self, track: Track, category: &'static str, name: &str, begin_us: f64, end_us: f64, args: Args) {
        self.push(|| {
            let kind = Kind::Complete { duration_us: end_us - begin_us };
            [Event { kind, name: name.to_owned(), category, track, time_us: begin_us, args }]
        });
    }

    /// Records an instant on one lane of a device, with arguments that describe it.
    pub fn mark(&self, device: u32, lane: Lane, name: &str, time_us: f64, args: &[(&str, &str)]) {
        self.push(|| {
            let args = args.iter().map(|&(name, text)| (name.to_owned(), text.into())).collect();
            let track = lane.track(device);
            [Event { kind: Kind::Instant, name: name.to_owned(), category: "device", track, time_us, args }]
        });
    }

    /// Records the values of counter `name` from `time_us` on, each as a series.
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

    /// Records arrows from the span around each point to the span around the next. `id` is unique to the chain. Fewer
    /// than two points give no arrow.
    pub fn flow(&self, id: u64, category: &'static str, points: &[(Track, f64)]) {
        let Some(last) = points.len().checked_sub(1).filter(|&last| last > 0) else { return };
        let step = |i: usize| match i {
            0 => FlowStep::Start,
            i if i == last => FlowStep::Finish,
            _ => FlowStep::Step,
        };
        let event = |(i, &(track, time_us)): (usize, &(Track, f64))| {
            let kind = Kind::Flow { step: step(i), id };
            Event { kind, name: category.to_owned(), category, track, time_us, args: Default::default() }
        };
        self.push(|| points.iter().enumerate().map(event));
    }

    /// Records a property of the whole run in `otherData`.
    pub fn note(&self, key: &str, value: impl Into<Value>) {
        if let Some(mut log) = self.lock() {
            log.notes.insert(key.to_owned(), value.into());
        }
    }

    /// Records the error bound of a clock, microseconds. `clock` is its name, such as `device_0` or `rank_1`. The
    /// maximum for each clock is written to `otherData`.
    pub fn note_residual(&self, clock: &str, residual_us: f64) {
        if let Some(mut log) = self.lock() {
            let key = format!("clock_residual_us.{clock}");
            let most_us = log.notes.get(&key).and_then(Value::as_f64).map_or(residual_us, |us| us.max(residual_us));
            log.notes.insert(key, most_us.into());
        }
    }

    /// Updates the file. Write errors are reported when the trace is finished.
    pub fn flush(&self) {
        if let Some(mut log) = self.lock() {
            log.write(false);
        }
    }

    /// Ends the trace. `is_complete` is false if the run ended early.
    ///
    /// # Errors
    /// [`TraceError::Write`] if this write or an earlier one failed.
    pub(super) fn close(&self, is_complete: bool) -> Result<(), TraceError> {
        let now_us = self.time_us(Instant::now());
        let Some(mut log) = self.lock() else { return Ok(()) };
        log.take_spans();
        log.host = None;
        for spans in std::mem::take(&mut log.spans).into_values() {
            log.extend(spans.unfinished(now_us));
        }
        log.write(is_complete);
        log.document = None;
        log.failure.take().map_or(Ok(()), Err)
    }

    fn push<E: IntoIterator<Item = Event>>(&self, events: impl FnOnce() -> E) {
        if let Some(mut log) = self.lock() {
            log.extend(events());
        }
    }

    pub(super) fn lock(&self) -> Option<MutexGuard<'_, Log>> {
        let log = self.log.as_ref()?;
        Some(log.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Log {
    fn extend(&mut self, events: impl IntoIterator<Item = Event>) {
        if self.document.is_none() {
            return;
        }
        for event in events {
            if has_sane_times(&event) {
                self.events.push(event);
            } else {
                self.dropped_events += 1;
            }
        }
    }

    fn take_spans(&mut self) {
        let text = self.host.as_mut().map_or_else(Vec::new, HostSpans::take);
        self.push_spans(HOST_PID, 0.0, &text);
    }

    fn push_spans(&mut self, pid: u32, zero_us: f64, text: &[u8]) {
        let spans = self.spans.entry(pid).or_insert_with(|| Spans::of(pid));
        let events = spans.events_from(text, zero_us);
        self.extend(events);
    }

    fn write(&mut self, is_complete: bool) {
        self.take_spans();
        let Some(document) = &mut self.document else { return };
        let mut other_data = self.notes.clone();
        other_data.insert("complete".to_owned(), is_complete.into());
        other_data.insert("dropped_events".to_owned(), self.dropped_events.into());
        other_data.insert("writer".to_owned(), concat!("diptych ", env!("CARGO_PKG_VERSION")).into());
        if let Err(error) = document.append(std::mem::take(&mut self.events), &other_data) {
            self.failure = Some(error);
            (self.document, self.host) = (None, None);
        }
    }
}

fn has_sane_times(event: &Event) -> bool {
    let duration_us = match event.kind {
        Kind::Complete { duration_us } => duration_us,
        _ => 0.0,
    };
    event.time_us.is_finite() && duration_us.is_finite() && duration_us >= 0.0
}
