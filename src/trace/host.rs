//! Host spans: what `tracing` records in this process, on the trace's own clock.
//!
//! `tracing-chrome` stamps with a clock of its own. Marker events, each read between two readings of ours, say
//! how far apart the two are; the tightest bracket wins, and half its width bounds the error.

use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use serde::Deserialize;
use tracing_chrome::{ChromeLayerBuilder, FlushGuard};
use tracing_subscriber::layer::SubscriberExt;

use super::event::{Arg, Args, Event, Kind, Track};
use super::{HOST_PID, TraceError};

const MARKER: &str = "diptych.clock";
const MARKER_COUNT: usize = 16;

/// Recording host spans, from [`HostSpans::install`] to [`HostSpans::collect`].
pub struct HostSpans {
    guard: FlushGuard,
    buffer: Buffer,
    /// For each marker in order: middle and half width of its bracket, µs after the origin.
    brackets: Vec<(f64, f64)>,
}

/// What was recorded, µs after the origin.
pub struct HostEvents {
    pub events: Vec<Event>,
    /// Bound on the error of the clock's alignment.
    pub clock_residual_us: f64,
}

#[derive(Clone, Default)]
struct Buffer(Arc<Mutex<Vec<u8>>>);

impl Write for Buffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut buffer = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        buffer.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl HostSpans {
    /// Makes this the process's `tracing` subscriber, which is possible once in its life.
    ///
    /// # Errors
    /// [`TraceError::SubscriberTaken`]
    pub fn install(origin: Instant) -> Result<HostSpans, TraceError> {
        let buffer = Buffer::default();
        let (layer, guard) =
            ChromeLayerBuilder::new().writer(buffer.clone()).include_args(true).include_locations(false).build();
        tracing::subscriber::set_global_default(tracing_subscriber::registry().with(layer))
            .map_err(|_| TraceError::SubscriberTaken)?;
        let elapsed_us = || origin.elapsed().as_nanos() as f64 / 1000.0;
        let mark = |_| {
            let before = elapsed_us();
            tracing::event!(name: MARKER, tracing::Level::INFO, {});
            let after = elapsed_us();
            ((before + after) / 2.0, (after - before) / 2.0)
        };
        let brackets = (0..MARKER_COUNT).map(mark).collect();
        Ok(HostSpans { guard, buffer, brackets })
    }

    /// Stops recording. Spans still open end at the last time recorded and carry `unfinished`.
    ///
    /// # Errors
    /// [`TraceError::HostSpans`]
    pub fn collect(self) -> Result<HostEvents, TraceError> {
        drop(self.guard);
        let bytes = std::mem::take(&mut *self.buffer.0.lock().unwrap_or_else(PoisonError::into_inner));
        let records: Vec<Record> =
            serde_json::from_slice(&bytes).map_err(|source| TraceError::HostSpans(source.to_string()))?;
        let (shift_us, clock_residual_us) = clock(&self.brackets, &records)
            .ok_or_else(|| TraceError::HostSpans("its clock markers are missing".to_owned()))?;
        Ok(HostEvents { events: events_from(records, shift_us), clock_residual_us })
    }
}

/// What to add to a recorded time to have it after our origin, and the bound on its error.
fn clock(brackets: &[(f64, f64)], records: &[Record]) -> Option<(f64, f64)> {
    let markers = records.iter().filter(|record| record.is_marker());
    let paired = brackets.iter().zip(markers.filter_map(|marker| marker.ts));
    paired.map(|(&(middle, half), ts)| (middle - ts, half)).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// An event as `tracing-chrome` writes it.
#[derive(Deserialize)]
struct Record {
    ph: String,
    name: String,
    tid: u32,
    ts: Option<f64>,
    #[serde(default)]
    args: HashMap<String, String>,
}

impl Record {
    fn is_marker(&self) -> bool {
        self.ph == "i" && self.name == MARKER
    }

    fn event(self, kind: Kind, shift_us: f64) -> Event {
        // `tracing` names an event after its place in the source unless told otherwise; its message says more.
        let message = self.args.get("message").filter(|_| self.name.starts_with("event "));
        Event {
            kind,
            name: message.unwrap_or(&self.name).clone(),
            category: "host",
            track: track(self.tid),
            time_us: self.ts.unwrap_or(0.0) + shift_us,
            args: args(self.args),
        }
    }
}

/// `tracing-chrome` counts threads from 0, which some viewers take for the idle thread.
fn track(tid: u32) -> Track {
    Track { pid: HOST_PID, tid: tid + 1 }
}

fn args(recorded: HashMap<String, String>) -> Args {
    recorded.into_iter().map(|(name, text)| (name, arg(text))).collect()
}

/// Every argument was recorded by its `Debug` text: numbers plain, strings quoted.
fn arg(text: String) -> Arg {
    match text.parse::<f64>() {
        Ok(number) => number.into(),
        Err(_) => Arg::Text(serde_json::from_str(&text).unwrap_or(text)),
    }
}

/// Joins begins with their ends and moves all to our clock.
fn events_from(records: Vec<Record>, shift_us: f64) -> Vec<Event> {
    let mut events = vec![Event::process_name(HOST_PID, "host"), Event::process_sort_index(HOST_PID, HOST_PID)];
    let last_us = records.iter().filter_map(|r| r.ts).fold(f64::MIN, f64::max) + shift_us;
    let mut open: HashMap<u32, Vec<Record>> = HashMap::new();
    for record in records {
        match record.ph.as_str() {
            "M" => {
                let name = record.args.get("name").map_or("thread", |name| name.as_str());
                events.push(Event::thread_name(track(record.tid), name));
            }
            "B" => open.entry(record.tid).or_default().push(record),
            "E" => {
                let stack = open.entry(record.tid).or_default();
                let Some(at) = stack.iter().rposition(|begun| begun.name == record.name) else {
                    continue;
                };
                let mut begun = stack.remove(at);
                let end_us = record.ts.unwrap_or(0.0) + shift_us;
                // Fields recorded while the span was open are known only at its end.
                begun.args.extend(record.args);
                events.push(complete(begun, end_us, shift_us));
            }
            "i" if !record.is_marker() => events.push(record.event(Kind::Instant, shift_us)),
            _ => {}
        }
    }
    for begun in open.into_values().flatten() {
        let mut event = complete(begun, last_us, shift_us);
        event.args.insert("unfinished".to_owned(), 1.0.into());
        events.push(event);
    }
    events
}

fn complete(begun: Record, end_us: f64, shift_us: f64) -> Event {
    let mut event = begun.event(Kind::Instant, shift_us);
    let duration_us = (end_us - event.time_us).max(0.0);
    event.kind = Kind::Complete { duration_us };
    event
}

#[cfg(test)]
mod tests {
    use super::*;

    fn records(json: &str) -> Vec<Record> {
        serde_json::from_str(json).unwrap()
    }

    #[test]
    fn begins_meet_their_ends_on_our_clock() {
        let recorded = r#"[
            {"ph":"M","pid":1,"name":"thread_name","tid":0,"args":{"name":"main"}},
            {"ph":"B","pid":1,"ts":10.0,"name":"frame","tid":0,"args":{"frame":"3"}},
            {"ph":"B","pid":1,"ts":11.0,"name":"cut","tid":0},
            {"ph":"B","pid":1,"ts":11.5,"name":"frame","tid":1},
            {"ph":"E","pid":1,"ts":12.0,"name":"cut","tid":0},
            {"ph":"E","pid":1,"ts":14.0,"name":"frame","tid":0,"args":{"frame":"3","rows":"90"}},
            {"ph":"E","pid":1,"ts":15.0,"name":"stray","tid":0},
            {"ph":"i","pid":1,"ts":16.0,"name":"event src/a.rs:7","tid":1,"s":"t","args":{"message":"late"}}]"#;
        let events = events_from(records(recorded), 100.0);
        let span = |name: &str, tid| {
            let found = events.iter().find(|e| e.name == name && e.track == track(tid));
            let event = found.unwrap_or_else(|| panic!("no {name}"));
            let Kind::Complete { duration_us } = event.kind else { panic!("{event:?}") };
            (event.time_us, duration_us, event.args.clone())
        };
        let number = |name: &str, value: f64| (name.to_owned(), Arg::Number(value));
        let frame_args = Args::from([number("frame", 3.0), number("rows", 90.0)]);
        assert_eq!(span("frame", 0), (110.0, 4.0, frame_args));
        assert_eq!(span("cut", 0), (111.0, 1.0, Args::new()));
        assert_eq!(span("frame", 1), (111.5, 4.5, Args::from([number("unfinished", 1.0)])));
        assert!(events.iter().any(|e| e.kind == Kind::Instant && e.name == "late"));
        assert!(events.contains(&Event::thread_name(track(0), "main")));
        assert!(!events.iter().any(|e| e.name == "stray"));
    }

    #[test]
    fn arguments_are_numbers_where_they_were() {
        assert_eq!(arg("7".into()), Arg::Number(7.0));
        assert_eq!(arg("-1.5e3".into()), Arg::Number(-1500.0));
        assert_eq!(arg("\"7\"".into()), Arg::Text("7".into()));
        assert_eq!(arg("true".into()), Arg::Text("true".into()));
        assert_eq!(arg("NaN".into()), Arg::Text("NaN".into()));
        assert_eq!(arg("Some(1)".into()), Arg::Text("Some(1)".into()));
    }
}
