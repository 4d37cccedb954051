use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::event::args_from;
use super::read::{parse, read};
use super::summary::{FrameDetail, Summary};
use super::*;

/// Records two frames on two devices. Times in µs:
/// device 0: left 0–1000, right 500–2000, both 3000–4000; download 1500–2500 (500 hidden)
/// device 1: left 1000–3000; upload 4000–5000
fn record(recorder: &Recorder) {
    recorder.device(0, "first gpu");
    recorder.device(1, "second gpu");
    let first = [("frame", 0.0), ("rows", 90.0)];
    let second = [("frame", 1.0)];
    recorder.task(0, Lane::Right, "gbuffer", [500.0, 2000.0], args_from(&first));
    recorder.task(0, Lane::Left, "gbuffer", [0.0, 1000.0], args_from(&first));
    recorder.task(1, Lane::Left, "path trace", [1000.0, 3000.0], args_from(&first));
    recorder.task(0, Lane::Download, "rows", [1500.0, 2500.0], args_from(&first));
    recorder.task(0, Lane::Both, "stitch", [3000.0, 4000.0], args_from(&second));
    recorder.task(1, Lane::Upload, "rows", [4000.0, 5000.0], args_from(&second));
    let budget = [("ms", 4.0), ("low", 11.0), ("high", 20.0)];
    recorder.counter("frame time", 4000.0, &budget);
    let points = [(Lane::Left, 0, 900.0), (Lane::Download, 0, 2000.0), (Lane::Upload, 1, 4500.0)];
    recorder.flow(3, "critical path", &points.map(|(lane, device, at_us)| (lane.track(device), at_us)));
    recorder.flow(4, "critical path", &[(Lane::Left.track(0), 900.0)]);
    recorder.note("clock_residual_us.device_0", 1.25);
}

fn written_by(record: impl FnOnce(Recorder)) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.json");
    let file = TraceFile::start_without_host(&path).unwrap();
    record(file.recorder());
    file.finish().unwrap();
    (folder, path)
}

fn written() -> (tempfile::TempDir, PathBuf) {
    written_by(|recorder| record(&recorder))
}

fn sum_up(path: &Path) -> Summary {
    Summary::of(&read(path).unwrap())
}

fn document(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn close(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-9, "{a} is not {b}");
}

#[test]
fn summary_of_a_known_trace_is_exact() {
    let (_folder, path) = written();
    let summary = sum_up(&path);
    let [a, b] = &summary.devices[..] else { panic!("{summary:?}") };
    assert_eq!((a.pid, a.name.as_str()), (10, "first gpu"));
    assert_eq!((b.pid, b.name.as_str()), (11, "second gpu"));
    close(summary.total_ms, 5.0);
    close(a.busy_ms, 3.0);
    close(a.transfer_ms, 1.0);
    close(a.hidden_transfer_ms, 0.5);
    close(a.idle_ms, 1.5);
    close(a.busy_share, 0.6);
    close(b.busy_ms, 2.0);
    close(b.transfer_ms, 1.0);
    close(b.idle_ms, 2.0);
    close(summary.overlap_share, 0.2);
    close(summary.hidden_transfer_share.unwrap(), 0.25);
    close(summary.imbalance.unwrap(), 1.2);
    let [first, second] = &summary.frames[..] else { panic!("{summary:?}") };
    assert_eq!((first.frame, second.frame), (0, 1));
    close(first.makespan_ms, 3.0);
    close(second.begin_ms, 3.0);
    close(second.makespan_ms, 2.0);
    assert_eq!((a.clock_residual_us, b.clock_residual_us), (Some(1.25), None));
    assert_eq!(summary.warnings, [""; 0]);
}

#[test]
fn device_is_not_idle_in_frames_of_others() {
    let (_folder, path) = written_by(|recorder| {
        for device in 0..2 {
            recorder.device(device, "gpu");
            recorder.task(device, Lane::Left, "gbuffer", [5000.0, 9000.0], args_from(&[("frame", 1.0)]));
        }
        // Older traces give the number of devices, which means the first ones.
        recorder.frame(0, 0.0, 3000.0, args_from(&[("frame", 0.0), ("devices", 1.0)]));
        recorder.task(0, Lane::Left, "gbuffer", [0.0, 3000.0], args_from(&[("frame", 0.0)]));
        let shared = |frame: f64, devices: &str| {
            let mut args = args_from(&[("frame", frame)]);
            args.insert("devices".to_owned(), devices.into());
            args
        };
        recorder.frame(0, 5000.0, 10_000.0, shared(1.0, "0,1"));
        // The first device is lost.
        recorder.frame(0, 11_000.0, 13_000.0, shared(2.0, "1"));
        recorder.task(1, Lane::Left, "gbuffer", [11_000.0, 13_000.0], args_from(&[("frame", 2.0)]));
    });
    let summary = sum_up(&path);
    assert_eq!(summary.devices.iter().map(|d| d.idle_ms).collect::<Vec<_>>(), [1.0, 1.0]);
    assert_eq!(summary.frames.iter().map(|f| f.idle_ms).collect::<Vec<_>>(), [0.0, 2.0, 0.0]);
    close(summary.devices[1].busy_share, 6.0 / 7.0);
}

#[test]
fn frames_in_flight_share_their_time() {
    let (_folder, path) = written_by(|recorder| {
        recorder.device(0, "gpu");
        for frame in 0..3u8 {
            let begin_us = 1000.0 * f64::from(frame);
            recorder.frame(usize::from(frame) % 2, begin_us, begin_us + 2000.0, args_from(&[("frame", frame.into())]));
            recorder.task(
                0,
                Lane::Left,
                "path_trace",
                [begin_us, begin_us + 750.0],
                args_from(&[("frame", frame.into())]),
            );
        }
    });
    let summary = sum_up(&path);
    assert_eq!(summary.frames.iter().map(|f| f.makespan_ms).collect::<Vec<_>>(), [2.0, 2.0, 2.0]);
    close(summary.total_ms, 4.0);
    close(summary.devices[0].busy_share, 2.25 / 4.0);
    close(summary.devices[0].idle_ms, 1.75);
}

#[test]
fn critical_path_covers_recorded_frame_times() {
    let (_folder, path) = written_by(|recorder| {
        record(&recorder);
        recorder.frame(0, -500.0, 3250.0, args_from(&[("frame", 0.0)]));
    });
    let trace = read(&path).unwrap();
    let summary = Summary::of(&trace);
    close(summary.frames[0].makespan_ms, 3.75);
    close(summary.frames[1].begin_ms, 3.5);
    // The second frame begins 0.25 ms before the first one ends.
    close(summary.total_ms, 5.5);
    close(summary.critical_path.iter().map(|part| part.ms_per_frame).sum(), 5.75 / 2.0);
    close(summary.critical_path.iter().map(|part| part.share).sum(), 1.0);
    let detail = FrameDetail::of(&trace, 0, "t").unwrap();
    let steps: Vec<_> = detail.steps.iter().map(|s| (s.what.as_str(), s.pid, s.begin_ms, s.time_ms)).collect();
    let expected = [("start of frame", 11, 0.0, 1.5), ("path trace", 11, 1.5, 2.0), ("end of frame", 11, 3.5, 0.25)];
    assert_eq!(steps, expected);
    assert_eq!((detail.summary.frames.len(), detail.summary.devices.len()), (1, 2));
    assert!(matches!(FrameDetail::of(&trace, 2, "t"), Err(TraceError::NoSuchFrame { count: 2, last: 1, .. })));
}

#[test]
fn summary_round_trips_through_json() {
    let (_folder, path) = written();
    let summary = sum_up(&path);
    let json = serde_json::to_string(&summary).unwrap();
    assert_eq!(serde_json::from_str::<Summary>(&json).unwrap(), summary);
}

#[test]
fn trace_file_has_lanes_notes_and_units() {
    let (_folder, path) = written();
    let document = document(&path);
    assert_eq!(document["displayTimeUnit"], "ms");
    assert_eq!(document["otherData"]["clock_residual_us.device_0"], 1.25);
    assert_eq!(document["otherData"]["complete"], true);
    assert_eq!(document["otherData"]["dropped_events"], 0);
    let events = document["traceEvents"].as_array().unwrap();
    let lane_names: Vec<_> = events
        .iter()
        .filter(|e| e["name"] == "thread_name" && e["pid"] == 10)
        .map(|e| e["args"]["name"].as_str().unwrap())
        .collect();
    assert_eq!(lane_names, ["left", "right", "both", "upload", "download"]);
    let times: Vec<_> = events.iter().filter_map(|e| e["ts"].as_f64()).collect();
    assert!(times.is_sorted());
    let arrows: Vec<_> = events.iter().filter(|e| e["id"] == 3).map(|e| e["ph"].as_str().unwrap()).collect();
    assert_eq!(arrows, ["s", "t", "f"]);
    assert!(!events.iter().any(|e| e["id"] == 4));
}

#[test]
fn disabled_recorder_records_nothing() {
    let recorder = Recorder::off();
    record(&recorder);
    assert!(!recorder.is_on());
    let later = recorder.origin() + std::time::Duration::from_micros(5);
    assert_eq!(recorder.time_us(later), 5.0);
}

#[test]
fn invalid_times_are_dropped_and_counted() {
    let (_folder, path) = written_by(|recorder| {
        recorder.device(0, "gpu");
        recorder.task(0, Lane::Left, "backwards", [5.0, 4.0], args_from(&[]));
        recorder.task(0, Lane::Left, "nowhen", [f64::NAN, 4.0], args_from(&[]));
        recorder.task(0, Lane::Left, "endless", [1.0, f64::INFINITY], args_from(&[]));
    });
    assert_eq!(document(&path)["otherData"]["dropped_events"], 3);
    assert!(sum_up(&path).devices[0].busy_ms == 0.0);
}

#[test]
fn panicking_run_leaves_a_valid_marked_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.json");
    let run = std::panic::AssertUnwindSafe(|| {
        let file = TraceFile::start_without_host(&path).unwrap();
        record(&file.recorder());
        let recorder = file.recorder();
        let worker = std::thread::spawn(move || {
            let _guard = recorder.lock();
            panic!("a worker dies while it holds the lock");
        });
        worker.join().unwrap();
    });
    assert!(std::panic::catch_unwind(run).is_err());
    assert_eq!(document(&path)["otherData"]["complete"], false);
    let summary = sum_up(&path);
    close(summary.total_ms, 5.0);
    assert!(summary.warnings[0].contains("ended early"));
}

#[test]
fn rejects_unwritable_trace_paths() {
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path().to_owned(), folder.path().join("no/such/trace.json")] {
        assert!(matches!(TraceFile::start_without_host(&path), Err(TraceError::Write(_))));
    }
}

#[test]
fn trace_file_is_valid_after_every_write() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trace.json");
    std::fs::write(&path, "longer than what is written first, and of no use".repeat(100)).unwrap();
    let file = TraceFile::start_without_host(&path).unwrap();
    let recorder = file.recorder();
    let events = || document(&path)["traceEvents"].as_array().unwrap().len();
    let names = events();
    for count in 1..=3 {
        recorder.task(0, Lane::Left, "gbuffer", [0.0, 1.0], args_from(&[]));
        assert_eq!(events(), names + count - 1);
        recorder.flush();
        assert_eq!(events(), names + count);
        assert_eq!(document(&path)["otherData"]["complete"], false);
    }
    file.finish().unwrap();
    assert_eq!(document(&path)["otherData"]["complete"], true);
    recorder.task(0, Lane::Left, "late", [0.0, 1.0], args_from(&[]));
    recorder.flush();
    assert_eq!(events(), names + 3);
}

/// Asserts that parsing `events` fails at `index` with a message that contains `says`.
#[track_caller]
fn wrong(events: Value, index: usize, says: &str) {
    let error = parse(events.to_string().as_bytes(), "t.json").unwrap_err();
    let TraceError::Event { index: found, what, .. } = &error else { panic!("{error}") };
    assert_eq!(*found, index, "{error}");
    assert!(what.contains(says), "`{error}` lacks `{says}`");
}

/// Events that name the lane `left` of a device and add a task on it.
fn lane() -> Value {
    json!({"ph": "M", "name": "thread_name", "pid": 10, "tid": 1, "args": {"name": "left"}})
}

fn task(ts: f64, dur: f64) -> Value {
    json!({"ph": "X", "name": "t", "pid": 10, "tid": 1, "ts": ts, "dur": dur})
}

#[test]
fn rejects_wrong_events() {
    wrong(json!([lane(), 7]), 1, "no object");
    wrong(json!([{"name": "x"}]), 0, "\"ph\"");
    wrong(json!([{"ph": "X", "pid": 1, "tid": 1, "dur": 1}]), 0, "\"ts\"");
    wrong(json!([{"ph": "X", "ts": 1, "tid": 1, "dur": 1}]), 0, "\"pid\"");
    wrong(json!([{"ph": "B", "ts": 1, "pid": 1}]), 0, "\"tid\"");
    wrong(json!([{"ph": "X", "ts": 1, "pid": 1, "tid": 1}]), 0, "\"dur\"");
    wrong(json!([{"ph": "s", "ts": 1, "pid": 1, "tid": 1}]), 0, "\"id\"");
    wrong(json!([{"ph": "i", "ts": "now", "pid": 1, "tid": 1}]), 0, "\"ts\"");
    wrong(json!([lane(), task(0.0, -1.0)]), 1, "below 0");
    wrong(json!([{"ph": "C", "ts": 1, "pid": 1, "name": "c"}]), 0, "counter");
    wrong(json!([{"ph": "C", "ts": 1, "pid": 1, "args": {"v": null}}]), 0, "'v' is null");
}

#[test]
fn begins_and_ends_must_balance() {
    let edge = |ph: &str, ts: f64, tid: u32| json!({"ph": ph, "name": "a", "pid": 1, "tid": tid, "ts": ts});
    let good = json!([edge("E", 4.0, 1), edge("B", 1.0, 1), edge("B", 2.0, 1), edge("E", 3.0, 1)]);
    parse(good.to_string().as_bytes(), "t").unwrap();
    wrong(json!([edge("B", 1.0, 1), edge("E", 2.0, 2), edge("E", 3.0, 1)]), 1, "never began");
    wrong(json!([edge("B", 1.0, 1), edge("B", 2.0, 1), edge("E", 3.0, 1)]), 0, "never ends");
    wrong(json!([edge("B", 3.0, 1), edge("E", 2.0, 1)]), 1, "never began");
}

#[test]
fn tasks_on_one_lane_must_not_overlap() {
    wrong(json!([lane(), task(5.0, 5.0), task(0.0, 6.0)]), 1, "event 2");
    let touching = json!([lane(), task(0.1, 0.2), task(0.3, 1.0), task(1.3, 0.0)]);
    assert_eq!(parse(touching.to_string().as_bytes(), "t").unwrap().tasks.len(), 3);
    let nested_elsewhere = json!([
        {"ph": "X", "pid": 77, "tid": 1, "ts": 0, "dur": 9},
        {"ph": "X", "pid": 77, "tid": 1, "ts": 1, "dur": 2},
    ]);
    parse(nested_elsewhere.to_string().as_bytes(), "t").unwrap();
}

#[test]
fn numeric_arguments_of_tasks_must_be_finite() {
    for bad in [json!(null), json!("NaN"), json!("-inf")] {
        let mut event = task(0.0, 1.0);
        event["args"] = json!({"stage": "gbuffer", "spp": bad});
        wrong(json!([lane(), event]), 1, "'spp'");
    }
    let mut event = task(0.0, 1.0);
    event["args"] = json!({"frame": 1.5});
    wrong(json!([lane(), event]), 1, "frame");
}

#[test]
fn traces_of_other_tools_load_with_warnings() {
    let foreign = json!([
        {"ph": "X", "name": "op", "pid": "Spans", "tid": "main", "ts": 0, "dur": 9},
        {"ph": "X", "name": "op", "pid": 12, "tid": 4, "ts": 0, "dur": 9},
        {"ph": "b", "cat": "net", "id2": {"local": "0x1"}, "pid": 12, "ts": 0},
        {"ph": "i", "s": "g", "ts": 4},
        {"ph": "Z", "ts": 4},
        {"ph": "f", "id": "a", "pid": 12, "tid": 4, "ts": 4},
    ]);
    let trace = parse(foreign.to_string().as_bytes(), "t").unwrap();
    let summary = Summary::of(&trace);
    assert_eq!((summary.devices.len(), summary.total_ms), (0, 0.0));
    assert_eq!((summary.imbalance, summary.hidden_transfer_share), (None, None));
    let warnings = summary.warnings.join("\n");
    for part in ["12, Spans", "'Z'", "1 arrows end", "no device work"] {
        assert!(warnings.contains(part), "no `{part}` in\n{warnings}");
    }
    assert!(matches!(FrameDetail::of(&trace, 0, "t"), Err(TraceError::NoFrames { .. })));
}

#[test]
fn rejects_files_that_are_no_trace() {
    for bad in ["", "[", "{}", "7", "null", "{\"traceEvents\": 3}", "[{\"ph\":\"X\",\"ts\":NaN}]", "[{\"ts\":1e999}]"] {
        let error = parse(bad.as_bytes(), "t.json").unwrap_err();
        assert!(matches!(error, TraceError::NotATrace { .. }), "{bad}: {error}");
    }
    let deep = "[".repeat(100_000);
    assert!(parse(deep.as_bytes(), "t.json").is_err());
    assert!(parse(&[0xff, 0xfe], "t.json").is_err());
    assert!(matches!(read(Path::new("no/such.json")), Err(TraceError::Read { .. })));
}

#[test]
fn unfinished_lists_load_up_to_the_last_event() {
    let begun = json!({"ph": "B", "name": "a", "pid": 1, "tid": 1, "ts": 1});
    for head in ["[", "{\"displayTimeUnit\": \"ms\", \"traceEvents\" : [\n"] {
        let text = format!("{head}{},\n{}, {},{{\"ph\":\"X", lane(), task(1.0, 2.0), begun);
        let trace = parse(text.as_bytes(), "cut").unwrap();
        assert_eq!((trace.tasks.len(), trace.warnings.len()), (1, 1), "{trace:?}");
    }
}

#[test]
fn damaged_traces_never_panic() {
    let (_folder, path) = written();
    let whole = std::fs::read(&path).unwrap();
    let tasks = parse(&whole, "whole").unwrap().tasks;
    let mut most = 0;
    for cut in 0..whole.trim_ascii_end().len() {
        let Ok(trace) = parse(&whole[..cut], "cut") else { continue };
        assert!(trace.warnings.iter().any(|warning| warning.contains("ended early")), "{cut}");
        assert!(trace.tasks.iter().all(|task| tasks.contains(task)));
        most = trace.tasks.len();
    }
    assert_eq!(most, tasks.len());
    let mut state = 1u64;
    let mut next = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for _ in 0..5000 {
        let mut bytes = whole.clone();
        for _ in 0..=next(3) {
            let at = next(bytes.len());
            bytes[at] = b"0123456789-eE.,:\"{}[]ntfXBECMsi"[next(31)];
        }
        if let Ok(trace) = parse(&bytes, "mutated") {
            let _ = Summary::of(&trace);
        }
    }
}
