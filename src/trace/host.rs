//! Host spans: what `tracing` tells of this process, on the trace's own clock.

use std::fmt::Debug;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use tracing::Subscriber;
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

use super::event::{Arg, Args, Event, Kind, Track};
use super::{FRAMES_TRACK, HOST_PID, Recorder, TraceError};

/// Makes `recorder` the process's `tracing` subscriber, which is possible once in its life.
///
/// # Errors
/// [`TraceError::SubscriberTaken`]
pub fn install(recorder: Recorder) -> Result<(), TraceError> {
    let subscriber = tracing_subscriber::registry().with(HostLayer { recorder });
    tracing::subscriber::set_global_default(subscriber).map_err(|_| TraceError::SubscriberTaken)
}

struct HostLayer {
    recorder: Recorder,
}

/// Threads are counted in the order in which they are first seen, after the track of frames.
fn thread_number() -> u32 {
    static NEXT: AtomicU32 = AtomicU32::new(FRAMES_TRACK.tid + 1);
    thread_local!(static NUMBER: u32 = NEXT.fetch_add(1, Ordering::Relaxed));
    // While a thread ends its number may be gone; spans of that moment share one.
    NUMBER.try_with(|number| *number).unwrap_or(u32::MAX)
}

impl HostLayer {
    /// An event of this thread, now.
    fn event(&self, kind: Kind, name: &str, args: Args) -> Event {
        let track = Track { pid: HOST_PID, tid: thread_number() };
        let time_us = self.recorder.time_us(Instant::now());
        Event { kind, name: name.to_owned(), category: "host", track, time_us, args }
    }
}

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for HostLayer {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let mut args = Args::new();
        attributes.record(&mut ArgsVisitor(&mut args));
        if let Some(span) = context.span(id) {
            span.extensions_mut().insert(args);
        }
    }

    fn on_record(&self, id: &Id, values: &Record<'_>, context: Context<'_, S>) {
        if let Some(span) = context.span(id)
            && let Some(args) = span.extensions_mut().get_mut::<Args>()
        {
            values.record(&mut ArgsVisitor(args));
        }
    }

    fn on_enter(&self, id: &Id, context: Context<'_, S>) {
        let Some(span) = context.span(id) else { return };
        let args = span.extensions().get::<Args>().cloned().unwrap_or_default();
        let event = self.event(Kind::Complete { duration_us: 0.0 }, span.name(), args);
        let Some(mut log) = self.recorder.lock() else { return };
        if log.named_threads.insert(event.track.tid) {
            let thread = std::thread::current();
            log.push(Event::thread_name(event.track, thread.name().unwrap_or("thread")));
        }
        log.open_spans.insert((id.into_u64(), event.track.tid), event);
    }

    fn on_exit(&self, id: &Id, context: Context<'_, S>) {
        let now_us = self.recorder.time_us(Instant::now());
        // Fields recorded while the span was open are known only now.
        let args = context.span(id).and_then(|span| span.extensions().get::<Args>().cloned());
        let Some(mut log) = self.recorder.lock() else { return };
        let Some(mut event) = log.open_spans.remove(&(id.into_u64(), thread_number())) else { return };
        event.kind = Kind::Complete { duration_us: now_us - event.time_us };
        event.args = args.unwrap_or(event.args);
        log.push(event);
    }

    fn on_event(&self, event: &tracing::Event<'_>, _context: Context<'_, S>) {
        let mut args = Args::new();
        event.record(&mut ArgsVisitor(&mut args));
        // `tracing` names an event after its place in the source unless told otherwise; its message says more.
        let name = match args.get("message") {
            Some(Arg::Text(message)) if event.metadata().name().starts_with("event ") => message.clone(),
            _ => event.metadata().name().to_owned(),
        };
        let event = self.event(Kind::Instant, &name, args);
        if let Some(mut log) = self.recorder.lock() {
            log.push(event);
        }
    }
}

struct ArgsVisitor<'a>(&'a mut Args);

impl ArgsVisitor<'_> {
    fn insert(&mut self, field: &Field, arg: Arg) {
        self.0.insert(field.name().to_owned(), arg);
    }
}

impl Visit for ArgsVisitor<'_> {
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.insert(field, value.into());
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        self.insert(field, (value as f64).into());
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        self.insert(field, (value as f64).into());
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.insert(field, value.into());
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.insert(field, Arg::Text(format!("{value:?}")));
    }
}
