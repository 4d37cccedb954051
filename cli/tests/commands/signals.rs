//! Signals that end a run: Ctrl-C, SIGTERM, and the hangup of a closed terminal.
#![cfg(unix)]

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::Folder;

/// Runs the command until this file exists, sends it the signal and returns its exit status.
fn interrupted(folder: &Folder, line: &str, signal: libc::c_int, file: &str) -> Option<i32> {
    let mut run = program(folder, line).stdout(Stdio::null()).spawn().unwrap();
    while !folder.path(file).exists() {
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

/// Returns a process that heeds SIGHUP even if these tests run under `nohup`.
fn program(folder: &Folder, line: &str) -> Command {
    let mut command = folder.program(line);
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
        let folder = Folder::new();
        let line = "render builtin:checker --size 32x18 --frames 100000 --trace ./trace.json --out ./out";
        assert_eq!(interrupted(&folder, line, signal, "out/stereo.0001.png"), Some(status));
        let frames = folder.json("out/run.json")["frames"].as_array().unwrap().len();
        assert!(frames >= 2, "{frames}");
        assert_eq!(folder.names("out").len(), 5 * frames + 2);
        assert_eq!(folder.json("out/run.json")["interrupted"], true);
        assert_eq!(folder.json("trace.json")["otherData"]["complete"], true);
    }
}

/// Longest time from a signal to the end of a command. It ends within a second on a machine that does nothing else.
const SOON: Duration = Duration::from_secs(4);

/// A frame of this command takes minutes. The signal comes in its first frame, or while pipelines are compiled.
#[test]
fn signal_ends_long_steps_soon() {
    for (line, at) in [
        ("render builtin:cornell --size 96x64 --spp 65536 --frames 2 --json --out ./", "warming up"),
        ("play builtin:cornell --size 3840x2160 --json --out ./", "warming up"),
        (
            "render builtin:cornell --size 96x64 --reference --spp 65536 --set pass_spp=4096 --json --out ./",
            "warming up",
        ),
    ] {
        let folder = Folder::new();
        let mut run = program(&folder, line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(run.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.any(|line| line.contains(at)), "no line contains '{at}'");
        std::thread::sleep(Duration::from_secs(3));
        assert_eq!(run.try_wait().unwrap(), None, "{line}: it has ended already");
        send(&run, libc::SIGINT);
        let begin = Instant::now();
        let output = run.wait_with_output().unwrap();
        let passed = begin.elapsed();
        assert_eq!(output.status.code(), Some(130), "{line}");
        assert!(passed < SOON, "{line}: it took {passed:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("interrupted"));
        assert!(!folder.path("left.exr").exists(), "{line}");
    }
}

#[test]
fn interrupted_still_keeps_its_samples() {
    let folder = Folder::new();
    let line = "render builtin:cornell --size 32x24 --spp 65536 --json --out ./";
    let mut run = program(&folder, line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(run.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut events = lines.map(|line| serde_json::from_str::<serde_json::Value>(&line).unwrap());
    let progress = events.find(|event| event["fraction"].as_f64().is_some_and(|fraction| fraction > 5e-4));
    assert!(progress.is_some(), "it ended before it had some samples");
    send(&run, libc::SIGINT);
    drop(events);
    assert_eq!(run.wait().unwrap().code(), Some(130));
    let report = folder.json("run.json");
    let spp = report["frames"][0]["spp_done"].as_u64().unwrap();
    assert!((4..65536).contains(&spp), "{spp}");
    assert_eq!((&report["interrupted"], &report["frames"][0]["spp"]), (&true.into(), &65536.into()));
    assert!(folder.path("left.exr").exists() && folder.path("stereo.png").exists());
}

/// Its frames take more than 200 ms each.
#[test]
fn interrupted_still_keeps_its_history() {
    let folder = Folder::new();
    let line = "render builtin:cornell --size 960x540 --spp 1 --warm-up 1000 --json --out ./";
    let (status, said) = interrupted_at("warm_up_frame", &mut program(&folder, line), libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    let report = folder.json("run.json");
    assert_eq!(report["frames"][0]["spp"], 1);
    assert!(report["warm_up_frames"].as_u64().unwrap() < 100, "{}", report["warm_up_frames"]);
    assert!(folder.path("left.exr").exists());
}

#[test]
fn time_limit_ends_a_picture_with_its_samples() {
    let folder = Folder::new();
    folder.run("render builtin:cornell --size 32x24 --time-limit 1 --out ./");
    let report = folder.json("run.json");
    let frame = &report["frames"][0];
    let spp = frame["spp_done"].as_u64().unwrap();
    assert!((1..4096).contains(&spp), "{spp}");
    assert_eq!((&frame["spp"], &report["interrupted"]), (&4096.into(), &serde_json::Value::Null));
    assert!(frame["makespan_ms"].as_f64().unwrap() < 1e4, "{frame}");
}

#[test]
fn interrupted_reference_keeps_its_samples() {
    let folder = Folder::new();
    let line = "render builtin:checker --size 32x18 --reference --spp 1000000 --set passes_out=./passes --out ./out";
    assert_eq!(interrupted(&folder, line, libc::SIGINT, "passes/reference.state"), Some(130));
    let reference = &folder.json("out/run.json")["references"][0];
    assert!((1..1_000_000).contains(&reference["spp"].as_u64().unwrap()), "{reference}");
    assert!(folder.path("out/left.exr").exists() && folder.path("out/stereo.png").exists());
}

#[test]
fn run_interrupted_at_its_start_replaces_no_file() {
    let folder = Folder::new();
    let line = "render builtin:checker --size 16x9 --warm-up 0 --also sheet --out ./";
    folder.run(line);
    let before = folder.files();
    let again = format!("{line} --json --frames 4");
    let (status, said) = interrupted_at("loading", &mut program(&folder, &again), libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    assert!(said.contains("interrupted") && !said.contains("result") && !said.contains("frames.csv"), "{said}");
    assert!(folder.files() == before);
}

#[test]
fn run_under_nohup_survives_a_hangup() {
    let folder = Folder::new();
    let mut command = program(&folder, "render builtin:checker --size 16x9 --json --out ./");
    on_hangup(&mut command, libc::SIG_IGN);
    let (status, said) = interrupted_at("loading", &mut command, libc::SIGHUP);
    assert_eq!(status, Some(0), "{said}");
}

#[test]
fn interrupted_sheet_shows_its_scenes_so_far() {
    let folder = Folder::new();
    let line = format!("export {} --size 40x30 --out ./sheet.png", "builtin:checker ".repeat(40));
    let mut command = program(&folder, &line);
    let mut run = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    // The first line of progress comes after some seconds.
    let mut lines = BufReader::new(run.stderr.take().unwrap()).lines().map(Result::unwrap);
    let progress = lines.find(|line| line.contains("/40 "));
    assert!(progress.is_some(), "it ended before its first line of progress");
    send(&run, libc::SIGTERM);
    assert!(lines.any(|line| line == "interrupted"));
    assert_eq!(run.wait().unwrap().code(), Some(143));
    let picture = image::open(folder.path("sheet.png")).unwrap();
    assert!(picture.height() >= 30, "{}", picture.height());
}

#[test]
fn interrupted_scale_writes_its_rows_so_far() {
    let folder = Folder::new();
    let line = "scale builtin:checker --size 16x9 --frames 200 --warm-up 0 --counts 2 --json --out ./";
    let (status, said) = interrupted_at("\"turn\"", &mut program(&folder, line), libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    // Counts take turns, so there are frames of both.
    assert_eq!(folder.text("scale.csv").lines().count(), 3, "a header, and one and two devices");
    assert!(folder.path("run.json").exists());
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn interrupted_check_writes_its_results_so_far() {
    let folder = Folder::new();
    let line = "info --check --json --sizes 16x9,1280x720 --out ./";
    let (status, said) = interrupted_at("measured", &mut program(&folder, line), libc::SIGINT);
    assert_eq!(status, Some(130), "{said}");
    let machine = folder.json("machine.json");
    assert_eq!(machine["frames"].as_array().unwrap().len(), 1, "{machine}");
    assert!(machine["left_out"][0].as_str().unwrap().contains("signal"), "{machine}");
}
