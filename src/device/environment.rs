//! The environment as the way to tell drivers what they take nowhere else. The library itself never changes it: other
//! threads may read it at any time, and only a program knows its threads.

use std::sync::OnceLock;

/// The variable from which Mesa's lavapipe reads its number of threads, while a device is opened.
pub(super) const THREADS: &str = "LP_NUM_THREADS";

static HOOK: OnceLock<fn(&str, &str)> = OnceLock::new();

/// Lets devices be opened with a number of threads each on drivers that read it from the environment: `set` sets a
/// variable, its first argument, to a value. Without a hook these drivers choose the number, and asking for one is
/// [`super::DeviceError::ThreadsUnsettable`]. The first hook stays.
///
/// ```no_run
/// # use diptych::device;
/// // SAFETY: no other thread of this program reads the environment while it opens devices.
/// unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
/// ```
///
/// # Safety
/// The library calls `set` whenever it opens such a device, one call at a time and never while it lists adapters. Nothing
/// else may access the environment at that time but through `std::env`.
pub unsafe fn set_environment_hook(set: fn(&str, &str)) {
    let _ = HOOK.set(set);
}

/// Returns true if there is a hook.
pub(super) fn is_settable() -> bool {
    HOOK.get().is_some()
}

/// Sets the number of threads of devices that are opened from here on, if there is a hook. Call it under the lock of
/// [`super::opening::OPENING`].
pub(super) fn set_threads(count: usize) {
    if let Some(set) = HOOK.get() {
        set(THREADS, &count.to_string());
    }
}
