//! Signals that end a run: Ctrl-C, SIGTERM, and the hangup of a closed terminal.
#![cfg(unix)]

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::common;
use serde_json::Value;

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Returns the number of files in a folder.
fn count(folder: &Path) -> usize {
    std::fs::read_dir(folder).unwrap().count()
}

/// Runs the command until `is_under_way`, sends it the signal and returns its exit status.
fn interrupted(args: &[&str], signal: libc::c_int, is_under_way: impl Fn() -> bool) -> Option<i32> {
    let mut run = program(args).stdout(Stdio::null()).spawn().unwrap();
    while !is_under_way() {
        assert_eq!(run.try_wait().unwrap(), None, "it has ended already");
        std::thread::sleep(Duration::from_millis(5));
    }
    send(&run, signal);
    run.wait().unwrap().code()
}

fn send(run: &std::process::Child, signal: libc::c_int) {
    // SAFETY: a signal to a child that has not been waited for.
    assert_eq!(unsafe { libc::kill(run.id() as libc::pid_t, signal) }, 0);
}

/// Starts a command that prints JSON. Sends it the signal after its first line that contains `text`. Returns its exit
/// status, and all that it printed after this line.
fn interrupted_at(text: &str, command: &mut Command, signal: libc::c_int) -> (Option<i32>, String) {
    let mut run = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(run.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.contains(text)), "no line contains '{text}'");
    send(&run, signal);
    let after: Vec<String> = lines.collect();
    let output = run.wait_with_output().unwrap();
    (output.status.code(), after.join("\n") + &String::from_utf8_lossy(&output.stderr))
}

/// Returns the program with these arguments. It heeds SIGHUP even if these tests run under `nohup`.
fn program(args: &[&str]) -> Command {
    let mut command = common::program(args);
    on_hangup(&mut command, libc::SIG_DFL);
    command
}

fn on_hangup(command: &mut Command, action: libc::sighandler_t) {
    // SAFETY: `signal` is safe between fork and exec.
    unsafe {
        command.pre_exec(move || {
            libc::signal(libc::SIGHUP, action);
            Ok(())
        });
    }
}

#[test]
fn signals_leave_complete_files() {
    for (signal, status) in [(libc::SIGINT, 130), (libc::SIGTERM, 143), (libc::SIGHUP, 129)] {
        assert_leaves_whole_files(signal, status);
    }
}

fn assert_leaves_whole_files(signal: libc::c_int, status: i32) {
    let folder = tempfile::tempdir().unwrap();
    let (out, trace) = (folder.path().join("out"), folder.path().join("trace.json"));
    let args =
        ["render", "builtin:checker", "--size", "32x18", "--frames", "100000", "--trace", trace.to_str().unwrap()];
    let args = [&args[..], &["--out", out.to_str().unwrap()]].concat();
    assert_eq!(interrupted(&args, signal, || out.join("stereo.0001.png").exists()), Some(status));
    let run = json(&out.join("run.json"));
    let frames = run["frames"].as_array().unwrap().len();
    assert!(frames >= 2, "{frames}");
    assert_eq!(count(&out), 5 * frames + 2);
    assert_eq!(json(&trace)["otherData"]["complete"], true);
}

#[test]
fn interrupted_reference_keeps_its_samples() {
    let folder = tempfile::tempdir().unwrap();
    let (out, passes) = (folder.path().join("out"), folder.path().join("passes"));
    let args = ["render", "builtin:checker", "--size", "32x18", "--reference", "--spp", "1000000"];
    let folders = ["--set", &format!("passes_out={}", passes.display()), "--out", out.to_str().unwrap()];
    let is_under_way = || passes.join("reference.state").exists();
    assert_eq!(interrupted(&[&args[..], &folders].concat(), libc::SIGINT, is_under_way), Some(130));
    let reference = &json(&out.join("run.json"))["references"][0];
    assert!(reference["spp"].as_u64().unwrap() < 1_000_000, "{reference}");
    assert!(reference["spp"].as_u64().unwrap() > 0, "{reference}");
    assert!(out.join("left.exr").exists() && out.join("stereo.png").exists());
}

#[test]
fn run_interrupted_at_its_start_replaces_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let args = ["render", "builtin:checker", "--size", "16x9", "--warm-up", "0", "--also", "sheet", "--out", out];
    assert!(program(&args).stdout(Stdio::null()).status().unwrap().success());
    let before = json(&folder.path().join("run.json"));
    let again = [&args[..], &["--json", "--frames", "4"]].concat();
    let (status, said) = interrupted_at("loading", &mut program(&again), libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    assert!(said.contains("interrupted") && !said.contains("result") && !said.contains("frames.csv"), "{said}");
    assert_eq!(json(&folder.path().join("run.json")), before);
    for name in before["pictures"].as_array().unwrap() {
        assert!(folder.path().join(name.as_str().unwrap()).exists(), "{name}");
    }
}

#[test]
fn run_under_nohup_survives_a_hangup() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let mut command = program(&["render", "builtin:checker", "--size", "16x9", "--json", "--out", out]);
    on_hangup(&mut command, libc::SIG_IGN);
    let (status, said) = interrupted_at("loading", &mut command, libc::SIGHUP);
    assert_eq!(status, Some(0), "{said}");
}

#[test]
fn interrupted_sheet_shows_its_scenes_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let sheet = folder.path().join("sheet.png");
    let scenes = ["builtin:checker"; 40];
    let options = ["--size", "40x30", "--out", sheet.to_str().unwrap()];
    let mut command = program(&[&["export"], &scenes[..], &options].concat());
    let mut run = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    // The first line of progress comes after some seconds.
    let mut lines = BufReader::new(run.stderr.take().unwrap()).lines().map(Result::unwrap);
    let progress = lines.find(|line| line.contains("/40 "));
    assert!(progress.is_some(), "it ended before its first line of progress");
    send(&run, libc::SIGTERM);
    assert!(lines.any(|line| line == "interrupted"));
    assert_eq!(run.wait().unwrap().code(), Some(143));
    let picture = image::open(&sheet).unwrap();
    assert!(picture.height() >= 30, "{}", picture.height());
}

#[test]
fn interrupted_scale_writes_its_rows_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let out = path("");
    let args = ["scale", "builtin:checker", "--size", "16x9", "--frames", "200", "--warm-up", "0", "--counts", "2"];
    let mut command = program(&[&args[..], &["--json", "--out", out.to_str().unwrap()]].concat());
    let (status, said) = interrupted_at("\"devices\":2", &mut command, libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    assert_eq!(std::fs::read_to_string(path("scale.csv")).unwrap().lines().count(), 2, "a header and one device");
    assert!(path("run.json").exists());
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn interrupted_check_writes_its_results_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let mut command = program(&["info", "--check", "--json", "--sizes", "16x9,1280x720", "--out", out]);
    let (status, said) = interrupted_at("measured", &mut command, libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    let machine = json(&folder.path().join("machine.json"));
    assert_eq!(machine["frames"].as_array().unwrap().len(), 1, "{machine}");
    assert!(machine["left_out"][0].as_str().unwrap().contains("signal"), "{machine}");
}
