//! Ctrl-C, SIGTERM and SIGHUP: the run abandons a frame that takes long, and writes the files of what is done. If this
//! takes too long, and at a second signal, the process ends at once.

use std::io::{self, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Once};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::console;
use super::failure::Failure;
#[cfg(feature = "mpi")]
pub use super::signals::raise;
pub use super::signals::{INTERRUPTED, is_set, signal};
use super::signals::{SIGNAL, exit_status};

/// Time that a command has to end by itself after a signal, unless it is writing.
const GRACE: Duration = Duration::from_millis(800);
/// Interval at which the process looks for a signal.
const CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Number of scopes that write files, which [`GRACE`] must not cut short.
static WRITING: AtomicUsize = AtomicUsize::new(0);

/// Makes Ctrl-C, SIGTERM and SIGHUP set [`INTERRUPTED`] instead of ending the process at once. A second one ends it,
/// and so does [`GRACE`]. `nohup` starts processes that ignore SIGHUP, and they go on ignoring it. A command with a
/// console of its own ignores signals.
pub fn watch() -> Result<(), Failure> {
    static STARTED: Once = Once::new();
    watch_signals()?;
    if console::is_of_process() {
        STARTED.call_once(|| {
            // Without this thread, a command ends after its current step.
            let _ = thread::Builder::new().name("signals".to_owned()).spawn(end_after_grace);
        });
    }
    Ok(())
}

/// Ends the process [`GRACE`] after a signal, once nothing is being written.
fn end_after_grace() {
    while !is_set() {
        thread::sleep(CHECK_INTERVAL);
    }
    let begin = Instant::now();
    while begin.elapsed() < GRACE || WRITING.load(Ordering::Relaxed) > 0 {
        thread::sleep(CHECK_INTERVAL / 5);
    }
    log!("{}", Failure::Interrupted.line());
    // Another thread may hold standard output, so do not flush it. It never holds a whole line back.
    signal_hook::low_level::exit(exit_status().into())
}

/// Ends the process at once with this exit status: drivers may be busy for a long time, and wait for their work when a
/// process ends in the usual way.
pub fn end(status: u8) -> ! {
    let _ = (io::stdout().flush(), io::stderr().flush());
    signal_hook::low_level::exit(status.into())
}

/// Scope in which files are written.
pub struct Writing(());

/// Begins to write files: a signal does not end the process before the returned value is dropped.
pub fn writing() -> Writing {
    WRITING.fetch_add(1, Ordering::Relaxed);
    Writing(())
}

impl Drop for Writing {
    fn drop(&mut self) {
        WRITING.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Makes signals set [`INTERRUPTED`] like [`watch`], but sets no time limit.
pub fn watch_signals() -> Result<(), Failure> {
    if !console::is_of_process() {
        return Ok(());
    }
    let watched = [SIGINT, SIGTERM].into_iter().try_for_each(watch_for);
    #[cfg(unix)]
    let watched = watched.and_then(|()| if is_ignored(SIGHUP) { Ok(()) } else { watch_for(SIGHUP) });
    watched.context("cannot watch for Ctrl-C").map_err(Failure::Run)
}

/// True if this process ignores a signal.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    // SAFETY: all zeros are a valid `sigaction`, and the call only reads the present one.
    unsafe {
        let mut present: libc::sigaction = std::mem::zeroed();
        libc::sigaction(signal, std::ptr::null(), &raw mut present) == 0 && present.sa_sigaction == libc::SIG_IGN
    }
}

fn watch_for(signal: i32) -> Result<(), io::Error> {
    flag::register_conditional_shutdown(signal, 128 | signal, Arc::clone(&INTERRUPTED))?;
    flag::register_usize(signal, Arc::clone(&SIGNAL), signal as usize)?;
    flag::register(signal, Arc::clone(&INTERRUPTED))?;
    Ok(())
}

/// Checks for an interruption.
///
/// # Errors
/// [`Failure::Interrupted`] once a signal came.
pub fn check() -> Result<(), Failure> {
    if is_set() { Err(Failure::Interrupted) } else { Ok(()) }
}

/// Returns `None` if a signal ended what returned `result`.
pub fn as_none<T>(result: Result<T, Failure>) -> Result<Option<T>, Failure> {
    match result {
        Err(Failure::Interrupted) => Ok(None),
        result => result.map(Some),
    }
}
