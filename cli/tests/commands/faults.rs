//! Commands go on without a device that fails, and refuse faults that cannot be made.

use std::path::Path;

use serde_json::Value;

use crate::common::diptych;

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Returns the names of the files in a folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_command_goes_on_without_its_first_device() {
    let folder = tempfile::tempdir().unwrap();
    let render = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let mut args = vec!["render", "builtin:checker", "--size", "64x36", "--frames", "3", "--aov", "motion"];
        // This denoiser keeps no history that could be lost.
        args.extend(["--denoiser", "atrous"]);
        args.extend(["--out", out.to_str().unwrap()]);
        args.extend(more);
        let output = diptych(&args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        (out, said)
    };
    let trace = folder.path().join("trace.json");
    let (one, _) = render("one", &[]);
    let lost = ["--virtual", "2", "--disturb", "loss:dev0@1", "--trace", trace.to_str().unwrap()];
    let (two, said) = render("two", &lost);
    assert!(said.contains("warning: device 0 failed in frame 1"), "{said}");
    assert_eq!(names(&one), names(&two));
    for name in names(&one).iter().filter(|n| !["run.json", "frames.csv"].contains(&n.as_str())) {
        let bytes = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert!(bytes(&one) == bytes(&two), "{name} differs");
    }
    let run = json(&two.join("run.json"));
    let [fault] = &run["faults"].as_array().unwrap()[..] else { panic!("{run}") };
    assert_eq!((&fault["frame"], &fault["device"], &fault["kind"]), (&1.into(), &0.into(), &"loss".into()));
    assert_eq!(run["devices"].as_array().unwrap().len(), 2);
    assert_eq!(run["frames"][2]["stripes"], serde_json::json!([0, 36]));
    let events = json(&trace);
    let marked = |e: &&Value| e["name"] == "device taken out" && e["pid"] == 10;
    assert_eq!(events["traceEvents"].as_array().unwrap().iter().filter(marked).count(), 1);
    let frames = events["traceEvents"].as_array().unwrap().iter().filter(|e| e["cat"] == "frame");
    assert_eq!(frames.map(|e| &e["args"]["devices"]).collect::<Vec<_>>(), ["0,1", "1", "1"]);
}

#[test]
fn without_a_device_left_the_command_fails() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().to_str().unwrap();
    let args = ["render", "builtin:checker", "--size", "32x18", "--frames", "2", "--out", to];
    let output = diptych(&[&args[..], &["--disturb", "loss:dev0@frame1"]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("no device is left") && said.contains("device 0"), "{said}");
    // Complete earlier files stay.
    assert!(names(folder.path()).contains(&"left.0000.exr".to_owned()));
}

#[test]
fn a_device_that_takes_too_long_is_out() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().to_str().unwrap();
    let args = ["render", "builtin:checker", "--size", "320x180", "--spp", "16", "--set", "watchdog_ms=1", "--out", to];
    let output = diptych(&args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("within 1 ms") || said.contains("more than 1 ms"), "{said}");
}

#[test]
fn faults_that_cannot_be_made_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().to_str().unwrap();
    for (more, expected) in [
        (["--disturb", "loss"], "write KIND:devI@FRAME"),
        (["--disturb", "melt:dev0@frame0"], "choose loss, hang, oom or slow"),
        (["--disturb", "loss:dev0@frame7"], "disturb loss:dev0@7: there is no frame 7: the last is frame 0"),
        (["--disturb", "slow:dev3@0..2"], "disturb slow:dev3@0..2: there is no device 3: there are 1"),
        (["--disturb", "scene-cut@0"], "only `diptych play` makes scene cuts"),
        (["--set", "slowdown=1,2"], "2 numbers"),
        (["--set", "slowdown=0"], "slowdown 0 is out of range"),
        (["--threads-per-device", "1,2"], "2 thread counts"),
        (["--set", "watchdog_ms=0"], "watchdog_ms 0 is out of range"),
        (["--set", "max_dispatch_ms=0"], "max_dispatch_ms 0 is out of range"),
    ] {
        let output = diptych(&[&["render", "builtin:checker", "--size", "16x9", "--out", to][..], &more].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{more:?}: {said}");
        assert!(said.contains(expected), "{more:?}: {said}");
    }
}
