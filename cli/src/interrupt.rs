//! Ctrl-C, SIGTERM and SIGHUP: the run finishes the current frame or pass and writes all files. A second signal exits
//! at once.

use std::io;
use std::sync::Arc;

use anyhow::Context;
#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::console;
use super::failure::Failure;
use super::signals::SIGNAL;
#[cfg(feature = "mpi")]
pub use super::signals::raise;
pub use super::signals::{INTERRUPTED, is_set, signal};

/// Makes Ctrl-C, SIGTERM and SIGHUP set [`INTERRUPTED`] instead of ending the process; a second one ends it. `nohup`
/// starts processes that ignore SIGHUP, and they go on ignoring it. A command with a console of its own ignores signals.
pub fn watch() -> Result<(), Failure> {
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
