//! Passes settings to drivers that read them only from the environment. The library never changes the environment by
//! itself: other threads may read it at any time, and only the program knows its threads.

use std::sync::OnceLock;

/// Variable from which Mesa's lavapipe reads its number of threads when a device is opened.
pub(super) const THREADS: &str = "LP_NUM_THREADS";

static HOOK: OnceLock<fn(&str, &str)> = OnceLock::new();

/// Installs a hook that sets an environment variable (first argument) to a value (second argument). It is needed to set
/// the number of threads per device on drivers that read this number from the environment. Without a hook, these
/// drivers choose the number, and requesting one fails with [`super::DeviceError::ThreadsUnsettable`]. Only the first
/// call has an effect.
///
/// ```no_run
/// # use diptych::device;
/// // SAFETY: no other thread of this program reads the environment while it opens devices.
/// unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
/// ```
///
/// # Safety
/// The library may call `set` whenever it opens a device: one call at a time, and never while it lists adapters. During
/// such a call, nothing else may access the environment except through `std::env`.
pub unsafe fn set_environment_hook(set: fn(&str, &str)) {
    let _ = HOOK.set(set);
}

/// Returns true if a hook is installed.
pub(super) fn is_settable() -> bool {
    HOOK.get().is_some()
}

/// Sets the number of threads for devices that are opened from now on, if there is a hook. The caller holds the lock of
/// [`super::opening::OPENING`].
pub(super) fn set_threads(count: usize) {
    if let Some(set) = HOOK.get() {
        set(THREADS, &count.to_string());
    }
}
