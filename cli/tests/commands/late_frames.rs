//! Late frames of `play` have causes, which the trace, the rows of frames and the summary tell alike.

use crate::common::Folder;
use crate::play::SMALL;
use diptych_cli::report::play::SETTLING_FRAMES;
use serde_json::Value;

/// Frames of 1 ms are late; a slowed device and a scene cut explain theirs.
#[test]
fn late_frames_agree_in_trace_rows_and_summary() {
    let folder = Folder::new();
    let shape = "--virtual 2 --frames 48 --trace ./trace.json --disturb slow:dev1@36..38 --disturb scene-cut@44";
    let said = folder.run(&format!("play builtin:cornell --fps 1000 --out ./out {SMALL} {shape}"));
    let run = folder.json("out/run.json");
    let rows = run["frames"].as_array().unwrap();
    let is_late = |row: &&Value| row["missed_periods"].as_u64().unwrap() > 0;
    let late: Vec<&Value> = rows.iter().filter(is_late).collect();
    assert!(late.len() > 8, "{} late frames", late.len());
    for row in rows {
        let ms = |name: &str| row[name].as_f64().unwrap();
        let whole_ms = ms("host_before_ms") + ms("makespan_ms") + ms("host_after_ms");
        assert!((ms("whole_ms") - whole_ms).abs() < 1e-6 && ms("host_before_ms") >= 0.0, "{row}");
        assert!((ms("over_deadline_ms") > 0.0) == is_late(&row) && row["cause"].is_string() == is_late(&row), "{row}");
    }
    for (index, cause) in [(36, "slow:dev1@36..38"), (37, "slow:dev1@36..38"), (44, "scene-cut@44")] {
        assert_eq!(rows[index]["cause"], cause, "{}", rows[index]);
    }
    let judged = rows[SETTLING_FRAMES..].iter().filter(|row| row["missed_periods"] == 0).count();
    assert_eq!(run["play"]["on_time_share"], judged as f64 / (48 - SETTLING_FRAMES) as f64);
    assert!(said.out.contains("frames were on time; late frames: ") && said.out.contains(" by "), "{}", said.out);

    let found = folder.run("trace ./trace.json --late --json").json();
    assert_eq!((&found["frames"], found["late"].as_array().unwrap().len()), (&48.into(), late.len()));
    for frame in found["late"].as_array().unwrap() {
        let row = &rows[frame["frame"].as_u64().unwrap() as usize];
        assert_eq!(frame["cause"], row["cause"]);
        assert!((frame["over_deadline_ms"].as_f64().unwrap() - row["over_deadline_ms"].as_f64().unwrap()).abs() < 1e-6);
    }
    let causes: u64 = found["causes"].as_array().unwrap().iter().map(|sum| sum["frames"].as_u64().unwrap()).sum();
    assert_eq!(causes as usize, late.len());
    let text = folder.run("trace ./trace.json --late").out;
    assert!(text.contains("late frames, the longest delay first") && text.contains("slow:dev1@36..38"), "{text}");

    let trace: Value = serde_json::from_str(&folder.text("trace.json")).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    let periods = events.iter().filter(|e| e["name"].as_str().unwrap().ends_with("late: missed period"));
    let missed: u64 = rows.iter().map(|row| row["missed_periods"].as_u64().unwrap().min(100)).sum();
    assert_eq!(periods.count() as u64, missed);
    let named = events.iter().filter(|e| e["ph"] == "X" && e["name"].as_str().unwrap().contains(", late "));
    assert_eq!(named.count(), late.len());
    assert_spans_nest(events);
    folder.run("render builtin:cornell --size 32x18 --spp 1 --trace ./still.json --out ./still");
    folder.refuses(2, "trace", "trace ./still.json --late => has no deadlines: give a trace of `diptych play`");
}

/// Viewers show only spans that are apart or one inside the other on each host track.
fn assert_spans_nest(events: &[Value]) {
    let on_host = events.iter().filter(|e| e["ph"] == "X" && e["pid"] == 1);
    let mut spans: Vec<(u64, f64, f64, &str)> = on_host
        .map(|e| {
            let [begin, time] = ["ts", "dur"].map(|name| e[name].as_f64().unwrap());
            (e["tid"].as_u64().unwrap(), begin, begin + time, e["name"].as_str().unwrap())
        })
        .collect();
    spans.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(b.2.total_cmp(&a.2)));
    let mut open: Vec<(u64, f64, f64, &str)> = Vec::new();
    for span in spans {
        open.retain(|other| other.0 == span.0 && other.2 > span.1 + 1e-3);
        assert!(open.iter().all(|other| span.2 <= other.2 + 1e-3), "{span:?} crosses {open:?}");
        open.push(span);
    }
}
