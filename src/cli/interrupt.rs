//! Ctrl-C and SIGTERM: the frame or pass that is being made is ended and all files are written; a second one ends at once.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use anyhow::Context;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::failure::Failure;

/// Whether Ctrl-C was pressed or SIGTERM came.
pub static INTERRUPTED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Default::default);

/// The number of the signal that came.
static SIGNAL: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Default::default);

/// What shells report of a program that the signal ended: 128 and its number.
pub fn exit_status() -> u8 {
    128 | SIGNAL.load(Ordering::Relaxed) as u8
}

/// From here on Ctrl-C and SIGTERM only set [`INTERRUPTED`].
pub fn watch() -> Result<(), Failure> {
    [SIGINT, SIGTERM].into_iter().try_for_each(watch_for).context("cannot watch for Ctrl-C").map_err(Failure::Run)
}

fn watch_for(signal: i32) -> Result<(), io::Error> {
    flag::register_conditional_shutdown(signal, 128 | signal, Arc::clone(&INTERRUPTED))?;
    flag::register_usize(signal, Arc::clone(&SIGNAL), signal as usize)?;
    flag::register(signal, Arc::clone(&INTERRUPTED))?;
    Ok(())
}

/// A signal has come to another process of the run.
#[cfg(feature = "mpi")]
pub fn raise(signal: i32) {
    SIGNAL.store(signal as usize, Ordering::Relaxed);
    INTERRUPTED.store(true, Ordering::Relaxed);
}

/// The signal that came, if one did.
pub fn signal() -> Option<i32> {
    is_set().then(|| SIGNAL.load(Ordering::Relaxed) as i32)
}

pub fn is_set() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// # Errors
/// [`Failure::Interrupted`] once Ctrl-C was pressed or SIGTERM came.
pub fn check() -> Result<(), Failure> {
    if is_set() { Err(Failure::Interrupted) } else { Ok(()) }
}
