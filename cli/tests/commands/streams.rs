//! Standard output and standard error that cannot be written, names that are not UTF-8, and folders that others share.
#![cfg(target_os = "linux")]

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixListener;
use std::process::Stdio;

use crate::common::{Folder, Said, Stream, run_with};

/// Runs the program in a folder as a process with this standard output.
fn run(folder: &Folder, line: &str, last: Option<&OsStr>, stdout: impl Into<Stdio>) -> Said {
    let mut command = folder.program(line);
    command.current_dir(folder.path("")).args(last).stdout(stdout).stderr(Stdio::piped());
    Said::new(command.spawn().unwrap().wait_with_output().unwrap())
}

/// A stream whose every write fails with this error of the system.
struct Broken(i32);

impl Write for Broken {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(io::Error::from_raw_os_error(self.0))
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Commands that print and need no images.
const COMMANDS: [&str; 9] = [
    "info",
    "info builtin:cornell",
    "info --json",
    "info --settings",
    "graph builtin:cornell --json",
    "generate bash",
    "generate man --out ./man",
    "render --help",
    "--version",
];

/// Returns a folder with the small frame `a` and its trace.
fn rendered() -> Folder {
    let folder = Folder::new();
    folder.run("render builtin:checker --size 16x9 --warm-up 0 --trace ./trace.json --out ./a");
    folder
}

#[test]
fn command_fails_if_its_output_is_full() {
    let folder = rendered();
    let of_files = [
        "compare ./a/left.exr ./a/left.exr --json",
        "compare ./a/left.exr ./a/left.exr",
        "trace ./trace.json",
        "export builtin:checker --out ./shot.toml",
        "export builtin:checker --out ./exported",
        "render builtin:checker --size 16x9 --warm-up 0 --json --out ./b",
    ];
    let assert_fails = |line: &str, status: Option<i32>, said: &str| {
        assert_eq!(status, Some(1), "{line}: {said}");
        assert!(said.contains("error: cannot write to standard output: No space left"), "{line}: {said}");
    };
    for line in of_files.into_iter().chain(COMMANDS) {
        let messages = Stream::default();
        let status = run_with(&folder.words(line), Broken(libc::ENOSPC), messages.clone());
        assert_fails(line, Some(status.into()), &String::from_utf8_lossy(&messages.take()));
    }
    for line in ["info", "render --help"] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let said = run(&folder, line, None, full);
        assert_fails(line, said.status, &said.errors);
    }
    assert!(folder.path("b/run.json").exists(), "files do not depend on standard output");
}

#[test]
fn command_ignores_a_closed_pipe() {
    let folder = Folder::new();
    for line in COMMANDS {
        let messages = Stream::default();
        let status = run_with(&folder.words(line), Broken(libc::EPIPE), messages.clone());
        assert_eq!((status, messages.take()), (0, Vec::new()), "{line}");
    }
    for line in ["info", "render --help"] {
        let (reader, writer) = io::pipe().unwrap();
        drop(reader);
        let said = run(&folder, line, None, writer);
        assert_eq!((said.status, said.errors), (Some(0), String::new()), "{line}");
    }
}

#[test]
fn command_ignores_errors_of_standard_error() {
    let folder = Folder::new();
    for (line, status) in [
        ("render builtin:checker --size 16x9 --warm-up 0 --exposure -9 --out ./a", 0),
        ("render missing.glb --out ./b", 2),
        ("render --unknown", 2),
    ] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let status_found = folder.program(line).stdout(Stdio::null()).stderr(full).status().unwrap();
        assert_eq!(status_found.code(), Some(status), "{line}");
    }
}

/// Returns a name with a byte that is not UTF-8.
fn bytes(name: &str) -> OsString {
    OsStr::from_bytes(&[name.as_bytes(), b"-\xff"].concat()).to_owned()
}

#[test]
fn output_folder_may_have_a_name_that_is_not_utf8() {
    let folder = Folder::new();
    for (name, line) in [
        ("render", "render builtin:checker --size 16x9 --warm-up 0 --out"),
        ("scale", "scale builtin:checker --size 16x9 --frames 1 --report --counts 1 --warm-up 0 --out"),
    ] {
        let out = bytes(name);
        run(&folder, line, Some(&out), Stdio::null()).success(name);
        let text = std::fs::read_to_string(folder.path("").join(&out).join("run.json")).unwrap();
        let run: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(run["command"].as_str().unwrap().ends_with(&format!("--out {name}-\u{fffd}")), "{}", run["command"]);
        assert_eq!(run["settings"]["out"], format!("{name}-\u{fffd}"));
    }
}

#[test]
fn every_path_may_have_bytes_that_are_not_utf8() {
    let folder = rendered();
    for line in [
        "trace ./trace.json",
        "compare ./a ./a --json --maps",
        "graph builtin:checker --dot",
        "generate man --out",
        "export builtin:checker --out",
        "render builtin:checker --size 16x9 --out ./b --set",
        "render",
    ] {
        let words = folder.words(line).into_iter().map(OsString::from);
        let args: Vec<OsString> = words.chain([folder.path("").join(bytes("name")).into()]).collect();
        let messages = Stream::default();
        let status = run_with(&args, io::sink(), messages.clone());
        assert!((0..=2).contains(&status), "{line}: {}", String::from_utf8_lossy(&messages.take()));
    }
    let line = "render builtin:checker --size 16x9 --out b --trace";
    run(&folder, line, Some(&bytes("trace")), Stdio::null()).success(line);
}

/// Without a private runtime folder, no shared one takes its place: anyone could plant a display server there, and the
/// program would connect to it.
#[test]
fn program_ignores_display_servers_in_shared_folders() {
    let shared = Folder::new();
    let planted = UnixListener::bind(shared.path("wayland-0")).unwrap();
    planted.set_nonblocking(true).unwrap();
    let mut command = shared.program("info");
    command.env("TMPDIR", shared.path(""));
    for variable in ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "NODEVICE_SELECT"] {
        command.env_remove(variable);
    }
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut spoken_to = false;
    while child.try_wait().unwrap().is_none() {
        spoken_to |= planted.accept().is_ok();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let said = Said::new(child.wait_with_output().unwrap()).success("info");
    assert!(!said.errors.contains("XDG_RUNTIME_DIR"), "{}", said.errors);
    assert!(!spoken_to && planted.accept().is_err());
}
