//! Ctrl-C: the frame or pass that is being made is ended and all files are written; a second one ends at once.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;

use super::failure::Failure;

/// Whether Ctrl-C was pressed.
pub static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// What shells report of a program that SIGINT ended: 128 + 2.
pub const EXIT_STATUS: u8 = 130;

/// From here on Ctrl-C only sets [`INTERRUPTED`].
pub fn watch() -> Result<(), Failure> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(EXIT_STATUS));
        }
    })
    .context("cannot watch for Ctrl-C")
    .map_err(Failure::Run)
}

pub fn is_set() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// # Errors
/// [`Failure::Interrupted`] once Ctrl-C was pressed.
pub fn check() -> Result<(), Failure> {
    if is_set() { Err(Failure::Interrupted) } else { Ok(()) }
}
