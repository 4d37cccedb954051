//! Records host spans: `tracing` reports them, `tracing-chrome` formats them as JSON text, and this module parses the
//! text and adds the spans to the trace.
//!
//! `tracing-chrome` writes a JSON list with a record per line from a thread of its own. Its timestamps count from an
//! origin that it does not report. This module therefore stores its own timestamp and the span's number in the category
//! of each record, and receives the text through a channel. The text of another process comes from the recorder of that
//! process, with times on that process's clock.

use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

use serde::Deserialize;
use tracing_chrome::{ChromeLayerBuilder, EventOrSpan, FlushGuard};
use tracing_subscriber::Registry;
use tracing_subscriber::layer::SubscriberExt;

use super::event::{Arg, Event, Kind, Track};
use super::{FIRST_THREAD_TID, TraceError};

/// Host spans that are being recorded.
pub struct HostSpans {
    guard: FlushGuard,
    text: Receiver<Piece>,
}

/// Message of the channel: text to append, or `None` as the marker that all text before it was flushed.
type Piece = Option<Vec<u8>>;

impl HostSpans {
    /// Installs a `tracing` subscriber that records the process's spans, which is possible once per process. Times
    /// count from `origin`.
    ///
    /// # Errors
    /// [`TraceError::SubscriberTaken`]
    pub fn install(origin: Instant) -> Result<HostSpans, TraceError> {
        // Building a second layer would cut this thread off from the first.
        if tracing::dispatcher::has_been_set() {
            return Err(TraceError::SubscriberTaken);
        }
        let (sender, text) = channel();
        let stamp = move |what: &EventOrSpan<'_, '_, Registry>| {
            let span = match what {
                EventOrSpan::Span(span) => span.id().into_u64(),
                EventOrSpan::Event(_) => 0,
            };
            format!("{} {span}", origin.elapsed().as_nanos())
        };
        let layer = ChromeLayerBuilder::new().include_args(true).include_locations(false);
        let (layer, guard) = layer.category_fn(Box::new(stamp)).writer(Pieces(sender)).build();
        let subscriber = tracing_subscriber::registry().with(layer);
        tracing::subscriber::set_global_default(subscriber).map_err(|_| TraceError::SubscriberTaken)?;
        Ok(HostSpans { guard, text })
    }

    /// Returns the text recorded since the last call, for the [`super::Recorder`] of this process or another.
    pub fn take(&mut self) -> Vec<u8> {
        self.guard.flush();
        let pieces: Vec<Vec<u8>> = self.text.iter().map_while(|piece| piece).collect();
        pieces.concat()
    }
}

/// Writer that sends its text through a channel. Without a receiver the text is dropped.
struct Pieces(Sender<Piece>);

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _ = self.0.send(Some(bytes.to_vec()));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let _ = self.0.send(None);
        Ok(())
    }
}

/// A record written by `tracing-chrome`.
#[derive(Deserialize)]
struct Record {
    ph: String,
    name: String,
    tid: u32,
    /// Nanoseconds since the `origin` of [`HostSpans::install`], a space, and the span's number. It is empty in records
    /// that name a thread.
    #[serde(default)]
    cat: String,
    /// Arguments, formatted by `Debug`.
    #[serde(default)]
    args: HashMap<String, String>,
}

/// Joins the begins and ends of the spans of one process.
pub(super) struct Spans {
    pid: u32,
    /// Origin of the times in the latest text, as a time of the trace.
    zero_us: f64,
    /// Open spans by number and thread, with times as in the text.
    open: HashMap<(u64, u32), Event>,
}

impl Spans {
    pub fn of(pid: u32) -> Self {
        Self { pid, zero_us: 0.0, open: HashMap::new() }
    }

    /// Returns the events of `text`: completed spans, instants and threads' names. `text` must end at the end of a
    /// record. Its times count from `zero_us`.
    pub fn events_from(&mut self, text: &[u8], zero_us: f64) -> Vec<Event> {
        self.zero_us = zero_us;
        let lines = text.split(|&byte| byte == b'\n').map(|line| line.strip_suffix(b",").unwrap_or(line));
        // Skip lines that are not records: the brackets of the list, and separators between two flushes.
        let records = lines.filter_map(|line| serde_json::from_slice(line).ok());
        let events = records.filter_map(|record| self.event(record));
        events.map(|event| Event { time_us: event.time_us + zero_us, ..event }).collect()
    }

    /// Returns the spans that are still open. They end at `now_us` and carry the argument `unfinished`.
    pub fn unfinished(self, now_us: f64) -> impl Iterator<Item = Event> {
        let zero_us = self.zero_us;
        self.open.into_values().map(move |mut event| {
            event.time_us += zero_us;
            event.kind = Kind::Complete { duration_us: (now_us - event.time_us).max(0.0) };
            event.args.insert("unfinished".to_owned(), 1.0.into());
            event
        })
    }

    fn event(&mut self, mut record: Record) -> Option<Event> {
        let track = Track { pid: self.pid, tid: FIRST_THREAD_TID.checked_add(record.tid)? };
        if record.ph == "M" {
            return Some(Event::thread_name(track, record.args.get("name")?));
        }
        let (time_ns, span) = record.cat.split_once(' ')?;
        let (time_us, span) = (time_ns.parse::<u64>().ok()? as f64 / 1e3, (span.parse().ok()?, track.tid));
        // By default, `tracing` names an event after its file and line; its message is more useful.
        let message = record.args.get("message").filter(|_| record.ph == "i" && record.name.starts_with("event "));
        let name = message.cloned().unwrap_or(std::mem::take(&mut record.name));
        let args = record.args.into_iter().map(|(name, text)| (name, arg(text))).collect();
        let event = Event { kind: Kind::Instant, name, category: "host", track, time_us, args };
        match record.ph.as_str() {
            "B" => {
                self.open.insert(span, event);
                None
            }
            // Fields that were recorded while the span was open arrive only with its end.
            "E" => {
                let begun = self.open.remove(&span)?;
                Some(Event { kind: Kind::Complete { duration_us: time_us - begun.time_us }, args: event.args, ..begun })
            }
            _ => Some(event),
        }
    }
}

/// Parses an argument. `Debug` prints numbers as they are and quotes strings.
fn arg(text: String) -> Arg {
    match text.parse::<f64>() {
        Ok(number) => number.into(),
        Err(_) => Arg::Text(serde_json::from_str(&text).unwrap_or(text)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::HOST_PID;

    /// Returns the events of a text that arrives in two parts.
    fn events(spans: &mut Spans, [a, b]: [&str; 2]) -> Vec<Event> {
        [a, b].iter().flat_map(|text| spans.events_from(text.as_bytes(), 0.0)).collect()
    }

    #[test]
    fn begin_events_pair_with_their_end_events() {
        let mut spans = Spans::of(HOST_PID);
        let first = r#"[
{"args":{"name":"main"},"name":"thread_name","ph":"M","pid":1,"tid":0},
{"args":{"frame":"3"},"cat":"10000 1","name":"frame","ph":"B","pid":1,"tid":0,"ts":1.0},
{"cat":"10500 1","name":"frame","ph":"B","pid":1,"tid":1,"ts":1.5},
{"cat":"11000 2","name":"frame","ph":"B","pid":1,"tid":0,"ts":2.0}"#;
        let second = r#",
{"args":{"frame":"3","rows":"90"},"cat":"14000 1","name":"frame","ph":"E","pid":1,"tid":0,"ts":5.0},
{"cat":"15000 2","name":"frame","ph":"E","pid":1,"tid":0,"ts":6.0},
{"cat":"15500 7","name":"stray","ph":"E","pid":1,"tid":0,"ts":6.5},
{"args":{"message":"late"},"cat":"16000 0","name":"event src/a.rs:7","ph":"i","pid":1,"s":"t","tid":1,"ts":7.0}
]"#;
        let found = events(&mut spans, [first, second]);
        let track = |tid| Track { pid: HOST_PID, tid: FIRST_THREAD_TID + tid };
        let number = |name: &str, value: f64| (name.to_owned(), Arg::Number(value));
        let event = |kind, name: &str, tid, time_us, args: &[(String, Arg)]| {
            let args = args.iter().cloned().collect();
            Event { kind, name: name.to_owned(), category: "host", track: track(tid), time_us, args }
        };
        let long = |duration_us| Kind::Complete { duration_us };
        let expected = [
            Event::thread_name(track(0), "main"),
            event(long(4.0), "frame", 0, 10.0, &[number("frame", 3.0), number("rows", 90.0)]),
            event(long(4.0), "frame", 0, 11.0, &[]),
            event(Kind::Instant, "late", 1, 16.0, &[("message".to_owned(), Arg::Text("late".to_owned()))]),
        ];
        assert_eq!(found, expected);
        assert_eq!(spans.open.keys().collect::<Vec<_>>(), [&(1, track(1).tid)]);
    }

    #[test]
    fn numeric_arguments_stay_numbers() {
        for (text, expected) in [("7", 7.0), ("-1.5e3", -1500.0)] {
            assert_eq!(arg(text.to_owned()), Arg::Number(expected));
        }
        let texts = [("\"7\"", "7"), ("true", "true"), ("NaN", "NaN"), ("Some(1)", "Some(1)")];
        for (text, expected) in texts {
            assert_eq!(arg(text.to_owned()), Arg::Text(expected.to_owned()));
        }
    }
}
