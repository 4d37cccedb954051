//! Host spans appear in the trace-file, on the recorder's clock. This is a single test, because a process can install
//! only one `tracing` subscriber; the other tests here run the program as a process.

use std::time::{Duration, Instant};

use diptych::trace::event::args_from;
use diptych::trace::read::read;
use diptych::trace::summary::Summary;
use diptych::trace::{Lane, Recorder, TraceError, TraceFile};

use crate::common::Folder;

/// Additional time that a loaded machine may need for a span.
const SLACK_US: f64 = 20_000.0;

/// Records a span with a field known only at its end, between two readings of our clock.
fn frame(recorder: &Recorder) -> (f64, f64) {
    let before = recorder.time_us(Instant::now());
    let span = tracing::info_span!("frame", frame = 3, label = "first", rows = tracing::field::Empty);
    span.in_scope(|| {
        std::thread::sleep(Duration::from_millis(5));
        tracing::info_span!("cut", share = 0.25).in_scope(|| tracing::info!("stripes moved"));
        span.record("rows", 90);
    });
    (before, recorder.time_us(Instant::now()))
}

#[test]
fn host_spans_use_the_clock_of_the_trace() {
    let folder = Folder::new();
    let path = folder.path("trace.json");
    let file = TraceFile::start(&path).unwrap();
    let recorder = file.recorder();
    recorder.device(0, "gpu");
    let (before_us, after_us) = frame(&recorder);
    recorder.task(0, Lane::Left, "gbuffer", [before_us, after_us], args_from(&[("frame", 3.0)]));
    let worker = std::thread::Builder::new().name("worker".to_owned());
    let work = || tracing::info_span!("work").in_scope(|| ());
    worker.spawn(work).unwrap().join().unwrap();
    let open = tracing::info_span!("never closed").entered();

    let second = folder.path("second.json");
    assert!(matches!(TraceFile::start(&second), Err(TraceError::SubscriberTaken)));
    assert!(!second.exists());
    tracing::info_span!("after the refusal", text = "\"7\" \n {}").in_scope(|| ());

    file.finish().unwrap();
    drop(open);
    tracing::info_span!("after the end").in_scope(|| ());

    let document = folder.json("trace.json");
    let events = document["traceEvents"].as_array().unwrap();
    let named = |name: &str| {
        let found: Vec<_> = events.iter().filter(|e| e["name"] == name).collect();
        assert_eq!(found.len(), 1, "{name}: {found:?}");
        found[0]
    };
    let frame = named("frame");
    assert_eq!(frame["pid"], 1);
    assert_eq!(frame["args"], serde_json::json!({"frame": 3.0, "rows": 90.0, "label": "first"}));
    let (begin_us, duration_us) = (frame["ts"].as_f64().unwrap(), frame["dur"].as_f64().unwrap());
    assert!(duration_us >= 5000.0);
    assert!(begin_us >= before_us && begin_us < before_us + SLACK_US);
    assert!(begin_us + duration_us <= after_us);

    assert_eq!(named("cut")["args"]["share"], 0.25);
    assert_eq!(named("after the refusal")["args"]["text"], "\"7\" \n {}");
    assert_eq!(named("stripes moved")["ph"], "i");
    assert_eq!(named("never closed")["args"]["unfinished"], 1.0);
    let worker_tid = &named("work")["tid"];
    let thread = events.iter().find(|e| e["name"] == "thread_name" && e["tid"] == *worker_tid && e["pid"] == 1);
    assert_eq!(thread.unwrap()["args"]["name"], "worker");
    let process = events.iter().find(|e| e["name"] == "process_name" && e["pid"] == 1);
    assert_eq!(process.unwrap()["args"]["name"], "host");
    assert!(events.iter().all(|e| e["ph"] != "B" && e["ph"] != "E"));

    let summary = Summary::of(&read(&path).unwrap());
    assert_eq!((summary.devices.len(), summary.frames.len()), (1, 1));
    assert_eq!(summary.warnings, [""; 0]);
}
