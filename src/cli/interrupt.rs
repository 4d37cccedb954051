//! Ctrl-C and SIGTERM: the run finishes the current frame or pass and writes all files. A second signal exits at once.

use std::io;
use std::sync::Arc;

use anyhow::Context;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::failure::Failure;
use super::signals::SIGNAL;
#[cfg(feature = "mpi")]
pub use super::signals::raise;
pub use super::signals::{INTERRUPTED, is_set, signal};

/// Makes Ctrl-C and SIGTERM set [`INTERRUPTED`] instead of ending the process; a second one ends it.
pub fn watch() -> Result<(), Failure> {
    [SIGINT, SIGTERM].into_iter().try_for_each(watch_for).context("cannot watch for Ctrl-C").map_err(Failure::Run)
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
/// [`Failure::Interrupted`] once Ctrl-C was pressed or SIGTERM came.
pub fn check() -> Result<(), Failure> {
    if is_set() { Err(Failure::Interrupted) } else { Ok(()) }
}
