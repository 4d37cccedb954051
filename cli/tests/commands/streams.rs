//! Standard output and standard error that cannot be written, and names that are not UTF-8.
#![cfg(target_os = "linux")]

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Output, Stdio};

use crate::common::{Stream, program, run_with};

/// Runs the program in a folder as a process with this standard output.
fn run(folder: &Path, args: &[&OsStr], stdout: impl Into<Stdio>) -> Output {
    let mut command = program(&[]);
    command.current_dir(folder).args(args).stdout(stdout).stderr(Stdio::piped());
    command.spawn().unwrap().wait_with_output().unwrap()
}

fn words(line: &str) -> Vec<&OsStr> {
    line.split(' ').map(OsStr::new).collect()
}

/// Returns the words of a line. `./` stands for this folder.
fn words_in(folder: &Path, line: &str) -> Vec<OsString> {
    let path = |word: &str| word.strip_prefix("./").map_or_else(|| word.into(), |name| folder.join(name).into());
    line.split(' ').map(path).collect()
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

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
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
fn rendered() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let line = "render builtin:checker --size 16x9 --warm-up 0 --trace trace.json --out a";
    let output = run(folder.path(), &words(line), Stdio::null());
    assert!(output.status.success(), "{}", errors(&output));
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
        let status = run_with(&words_in(folder.path(), line), Broken(libc::ENOSPC), messages.clone());
        assert_fails(line, Some(status.into()), &String::from_utf8_lossy(&messages.take()));
    }
    for line in ["info", "render --help"] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let output = run(folder.path(), &words(line), full);
        assert_fails(line, output.status.code(), &errors(&output));
    }
    assert!(folder.path().join("b/run.json").exists(), "files do not depend on standard output");
}

#[test]
fn command_ignores_a_closed_pipe() {
    let folder = tempfile::tempdir().unwrap();
    for line in COMMANDS {
        let messages = Stream::default();
        let status = run_with(&words_in(folder.path(), line), Broken(libc::EPIPE), messages.clone());
        assert_eq!((status, messages.take()), (0, Vec::new()), "{line}");
    }
    for line in ["info", "render --help"] {
        let (reader, writer) = io::pipe().unwrap();
        drop(reader);
        let output = run(folder.path(), &words(line), writer);
        assert_eq!((output.status.code(), errors(&output)), (Some(0), String::new()), "{line}");
    }
}

#[test]
fn command_ignores_errors_of_standard_error() {
    let folder = tempfile::tempdir().unwrap();
    for (line, status) in [
        ("render builtin:checker --size 16x9 --warm-up 0 --exposure -9 --out a", 0),
        ("render missing.glb --out b", 2),
        ("render --unknown", 2),
    ] {
        let full = || File::options().write(true).open("/dev/full").unwrap();
        let mut command = program(&[]);
        command.current_dir(folder.path()).args(words(line)).stdout(Stdio::null()).stderr(full());
        assert_eq!(command.status().unwrap().code(), Some(status), "{line}");
    }
}

/// Returns a name with a byte that is not UTF-8.
fn bytes(name: &str) -> OsString {
    OsStr::from_bytes(&[name.as_bytes(), b"-\xff"].concat()).to_owned()
}

#[test]
fn output_folder_may_have_a_name_that_is_not_utf8() {
    let folder = tempfile::tempdir().unwrap();
    for (name, line) in [
        ("render", "render builtin:checker --size 16x9 --warm-up 0 --out"),
        ("scale", "scale builtin:checker --size 16x9 --frames 1 --report --counts 1 --warm-up 0 --out"),
    ] {
        let out = bytes(name);
        let output = run(folder.path(), &[&words(line)[..], &[&out]].concat(), Stdio::null());
        assert_eq!(output.status.code(), Some(0), "{name}: {}", errors(&output));
        let text = std::fs::read_to_string(folder.path().join(&out).join("run.json")).unwrap();
        let run: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(run["command"].as_str().unwrap().ends_with(&format!("--out {name}-\u{fffd}")), "{}", run["command"]);
        assert_eq!(run["settings"]["out"], format!("{name}-\u{fffd}"));
    }
}

#[test]
fn every_path_may_have_bytes_that_are_not_utf8() {
    let folder = rendered();
    let name = bytes("name");
    for line in [
        "trace ./trace.json",
        "compare ./a ./a --json --maps",
        "graph builtin:checker --dot",
        "generate man --out",
        "export builtin:checker --out",
        "render builtin:checker --size 16x9 --out ./b --set",
        "render",
    ] {
        let args = [words_in(folder.path(), line), vec![folder.path().join(&name).into()]].concat();
        let messages = Stream::default();
        let status = run_with(&args, io::sink(), messages.clone());
        assert!((0..=2).contains(&status), "{line}: {}", String::from_utf8_lossy(&messages.take()));
    }
    let line = "render builtin:checker --size 16x9 --out b --trace";
    let output = run(folder.path(), &[&words(line)[..], &[&bytes("trace")]].concat(), Stdio::null());
    assert_eq!(output.status.code(), Some(0), "{line}: {}", errors(&output));
}
