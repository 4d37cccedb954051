//! The signals that end a run.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

/// True once Ctrl-C was pressed, or SIGTERM or SIGHUP came.
pub static INTERRUPTED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Default::default);

/// Number of the received signal.
pub static SIGNAL: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Default::default);

/// Returns the exit status that shells report for a program that the signal ended: 128 plus its number.
pub fn exit_status() -> u8 {
    128 | SIGNAL.load(Ordering::Relaxed) as u8
}

/// Records a signal that another process of the run received.
#[cfg(feature = "mpi")]
pub fn raise(signal: i32) {
    SIGNAL.store(signal as usize, Ordering::Relaxed);
    INTERRUPTED.store(true, Ordering::Relaxed);
}

/// Returns the received signal, if any.
pub fn signal() -> Option<i32> {
    is_set().then(|| SIGNAL.load(Ordering::Relaxed) as i32)
}

pub fn is_set() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}
