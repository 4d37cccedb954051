//! Helpers of the tests of commands.

#![allow(dead_code, unused_imports)] // Each test binary uses a part.

#[path = "../../../tests/common/mod.rs"]
pub mod stage;

mod folder;

use std::ffi::OsStr;
use std::io::{self, Write};
use std::process::{Command, ExitStatus, Output};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use diptych::device::{self, DevicePool};
use diptych_cli::{Console, CoreTime, run_from};
pub use folder::{Folder, Said};
pub use stage::is_thorough;

/// A stream of a command.
#[derive(Clone, Default)]
pub struct Stream(Arc<Mutex<Vec<u8>>>);

impl Stream {
    /// Returns what has been written since the last call.
    pub fn take(&self) -> Vec<u8> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Runs a command in this process, on devices that keep their pipelines for the next command. [`program`] is for
/// commands that need a process: for its signals, streams, environment or folder. With `--trace` it runs here as well,
/// since a process records its spans once.
fn diptych(args: &[String]) -> Output {
    if args.iter().any(|arg| arg == "--trace") {
        return program(args).output().unwrap_or_else(|e| panic!("cannot start diptych: {e}"));
    }
    beside(args, |_| 0.0)
}

/// Fraction of the cores that other programs take, by the number of the reading.
pub type Share = fn(u32) -> f64;

/// Runs a command in this process beside other programs that seem to take `share` of the cores. A second passes between
/// the readings of their time; `share` gets the number of the reading.
fn beside(args: &[String], share: Share) -> Output {
    let [out, error] = [Stream::default(), Stream::default()];
    let time = Mutex::new((0, CoreTime::default()));
    let clock = move || {
        let mut time = time.lock().unwrap_or_else(PoisonError::into_inner);
        let (number, CoreTime { others_s, all_s }) = *time;
        *time = (number + 1, CoreTime { others_s: others_s + share(number), all_s: all_s + 1.0 });
        Some(time.1)
    };
    let status = run_on(args, Console::new(out.clone(), error.clone()).core_time(clock));
    Output { status: exit_status(status), stdout: out.take(), stderr: error.take() }
}

/// Runs a command in this process with these streams; returns its exit status.
pub fn run_with(
    args: &[impl AsRef<OsStr>],
    out: impl Write + Send + 'static,
    error: impl Write + Send + 'static,
) -> u8 {
    run_on(args, Console::new(out, error))
}

fn run_on(args: &[impl AsRef<OsStr>], console: Console) -> u8 {
    static DEVICES: LazyLock<DevicePool> = LazyLock::new(|| {
        // SAFETY: tests access the environment only through `std::env`, and list adapters only through the library.
        unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
        DevicePool::default()
    });
    let args = args.iter().map(AsRef::as_ref);
    run_from([OsStr::new("diptych")].into_iter().chain(args), console.devices(DEVICES.clone()))
}

#[cfg(unix)]
fn exit_status(status: u8) -> ExitStatus {
    std::os::unix::process::ExitStatusExt::from_raw(i32::from(status) << 8)
}

#[cfg(windows)]
fn exit_status(status: u8) -> ExitStatus {
    std::os::windows::process::ExitStatusExt::from_raw(status.into())
}

/// Returns a command that runs the built program.
fn program(args: &[String]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_diptych"));
    command.args(args);
    command
}
