//! A run's trace-file is valid even if the run dies. `diptych trace` reads it alone or beside another, and `run.json`
//! has the sums of its tasks.

use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::Folder;
use serde_json::Value;

/// Renders on two devices and is killed between two writes, after the second frame. Leaves `trace.json`.
fn kill_a_run(folder: &Folder) {
    let line = "render builtin:checker --size 48x32 --virtual 2 --threads-per-device 1 --frames 100000 --quiet";
    let mut run = folder.start(&format!("{line} --trace ./trace.json --out ./out"), Stdio::null());
    let begin = Instant::now();
    let text = || std::fs::read_to_string(folder.path("trace.json")).unwrap_or_default();
    while text().matches("\"name\":\"frame\",\"cat\":\"frame\"").count() < 2 {
        assert!(run.try_wait().unwrap().is_none(), "the run ended by itself");
        assert!(begin.elapsed() < Duration::from_secs(120), "no frame in two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    stop_between_writes(&run);
    run.kill().unwrap();
    run.wait().unwrap();
}

/// Waits until all threads of the process are stopped. A stopped process has finished its calls of `write`, whereas
/// Linux cuts off a `write` of several pages if the process is killed meanwhile.
#[cfg(unix)]
fn stop_between_writes(run: &std::process::Child) {
    let pid = run.id() as libc::pid_t;
    let mut status = 0;
    // SAFETY: both calls name a child of this process that nobody has waited for, and `status` outlives them.
    unsafe {
        assert_eq!(libc::kill(pid, libc::SIGSTOP), 0);
        assert_eq!(libc::waitpid(pid, &raw mut status, libc::WUNTRACED), pid);
    }
    assert!(libc::WIFSTOPPED(status), "the run ended by itself");
}

#[cfg(not(unix))]
fn stop_between_writes(_: &std::process::Child) {}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn killed_run_leaves_a_valid_trace() {
    let folder = Folder::new();
    kill_a_run(&folder);
    let printed = |line: &str| folder.run(line).out;
    let json = |line: &str| folder.run(&format!("{line} --json")).json();
    let document = folder.json("trace.json");
    assert_eq!(document["otherData"]["complete"], false);
    let events = document["traceEvents"].as_array().unwrap();
    let on_host =
        |name: &str| events.iter().filter(|e| e["name"] == name && e["pid"] == 1 && e["cat"] == "host").count();
    // Expect two devices and at least two frames.
    assert!(on_host("device frame") >= 4 && on_host("finish frame") >= 2 && on_host("load scene") == 1);

    let text = printed("trace ./trace.json");
    for part in ["device 0: ", "device 1: ", "imbalance", "critical path", "path_trace left", "ended early"] {
        assert!(text.contains(part), "no `{part}` in\n{text}");
    }
    let summary = json("trace ./trace.json");
    let parts = summary["critical_path"].as_array().unwrap();
    let shares: f64 = parts.iter().map(|part| number(&part["share"])).sum();
    assert!((shares - 1.0).abs() < 1e-9, "the path is {shares} of the frames");
    for device in summary["devices"].as_array().unwrap() {
        let used_ms =
            number(&device["busy_ms"]) + number(&device["transfer_ms"]) - number(&device["hidden_transfer_ms"]);
        let residual_us = number(&device["clock_residual_us"]);
        assert!(residual_us > 0.0 && residual_us < 1000.0 && used_ms > 0.0, "{device}");
        assert!((used_ms + number(&device["idle_ms"]) - number(&summary["total_ms"])).abs() < 0.1, "{device}");
    }

    let detail = json("trace ./trace.json --frame 1");
    let steps = detail["steps"].as_array().unwrap();
    let makespan_ms = number(&detail["summary"]["frames"][0]["makespan_ms"]);
    let path_ms: f64 = steps.iter().map(|step| number(&step["time_ms"])).sum();
    assert!((path_ms - makespan_ms).abs() < 1e-6, "{path_ms} ms of {makespan_ms}");
    assert!(printed("trace ./trace.json --frame 1").contains("step by step"));

    let same = json("trace ./trace.json ./trace.json");
    let changes =
        |key: &str| same[key].as_array().unwrap().iter().map(|c| number(&c["difference"])).collect::<Vec<_>>();
    assert!(changes("stages").len() > 5 && changes("stages").iter().chain(&changes("frames")).all(|&d| d == 0.0));
    assert!(printed("trace ./trace.json ./trace.json").contains("makespan ms"));

    // A run killed within a write leaves a file that ends within an event.
    let whole = folder.text("trace.json");
    folder.write("trace.json", &whole[..whole.rfind(",\n{").unwrap() + 9]);
    let cut = json("trace ./trace.json");
    assert!(cut["warnings"].to_string().contains("ended early"), "{}", cut["warnings"]);
    assert_eq!(cut["devices"].as_array().unwrap().len(), 2);
}

#[test]
fn run_json_sums_tasks_and_lists_them_on_request() {
    let folder = Folder::new();
    let line = "render builtin:cornell --size 48x32 --virtual 2 --frames 4";
    let text = folder.run(&format!("{line} --out ./brief")).out;
    let brief = folder.text("brief/run.json");
    assert!(brief.len() < 4 * 8000, "{} bytes for 4 frames", brief.len());
    let brief: Value = serde_json::from_str(&brief).unwrap();
    let frames = brief["frames"].as_array().unwrap();
    assert!(frames.iter().all(|f| f.get("tasks").is_none()));
    // The printed sums cover all frames but the first.
    let sum = |name: &str| frames[1..].iter().map(|f| number(&f[name])).sum::<f64>();
    let said = format!("{:.2} Mrays/s", sum("rays") / sum("makespan_ms") * 1e-3);
    let warm_up = format!("warm-up {:.1} s; 4 frame(s)", number(&brief["warm_up_s"]));
    assert!(text.contains(&said) && text.contains(&warm_up), "{text} without {said} or {warm_up}");

    folder.run(&format!("{line} --also details --out ./detailed"));
    for frame in folder.json("detailed/run.json")["frames"].as_array().unwrap() {
        let (stages, tasks) = (frame["stages"].as_array().unwrap(), frame["tasks"].as_array().unwrap());
        let of = |v: &Value| (v["stage"].clone(), v["view"].clone(), v["device"].clone());
        for stage in stages {
            let transfers = stage.get("bytes").is_some();
            assert_eq!(transfers, ["download", "upload"].contains(&stage["stage"].as_str().unwrap()), "{stage}");
            if !transfers {
                let own = tasks.iter().filter(|t| t.get("bytes").is_none() && of(t) == of(stage));
                let own_ms: f64 = own.map(|t| number(&t["end_ms"]) - number(&t["begin_ms"])).sum();
                assert!((own_ms - number(&stage["busy_ms"])).abs() < 0.000_51, "{stage}: {own_ms}");
            }
        }
        let bytes = |rows: &[Value]| rows.iter().filter_map(|r| r.get("bytes")).map(number).sum::<f64>();
        assert!(bytes(stages) == bytes(tasks) && bytes(tasks) == 2.0 * number(&frame["transferred_bytes"]), "{frame}");
        let is_once = |s: &Value| stages.iter().filter(|other| of(other) == of(s)).count() == 1;
        assert!(stages.iter().all(is_once), "{frame}");
        assert!(tasks.iter().all(|t| number(&t["begin_ms"]) >= 0.0), "{frame}");
    }
}

#[test]
fn rejects_foreign_files_where_traces_are_needed() {
    let folder = Folder::new();
    folder.write("foreign.json", r#"[{"ph": "X", "name": "op", "pid": 7, "tid": 1, "ts": 0, "dur": 9}]"#);
    folder.write("table.csv", "devices,makespan_ms\n");
    assert!(folder.run("trace ./foreign.json").out.contains("note: there is no device work"));
    let table = "
        trace ./foreign.json ./foreign.json => foreign.json' has no frames
        trace ./foreign.json --frame 0 => foreign.json' has no frames
        trace ./foreign.json ./table.csv => table.csv' is not a trace
        trace ./foreign.json ./foreign.json --frame 0 => cannot be used with
    ";
    folder.refuses(2, "", table);
}
