//! Environment variables that configure drivers and loaders.

use diptych::device;

/// Sets the environment variables that drivers and loaders read, and lets the library set those that a device reads
/// while it opens. Without this call, `--threads-per-device` is an error on Mesa's software driver. Call it at the
/// beginning of `main`.
///
/// # Safety
/// The process must have no other thread yet. Threads that it starts later may read the environment only through
/// [`mod@std::env`].
pub unsafe fn prepare_environment() {
    // SAFETY: there is no other thread, as the caller promises.
    let set = |name: &str, value: &str| unsafe { std::env::set_var(name, value) };
    // Mesa's device-select layer contacts the Wayland server and prints an error on every start without one, as in
    // containers. Disable it there.
    if cfg!(target_os = "linux") && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        set("NODEVICE_SELECT", "1");
    }
    // Silence OpenXR's loader, since our own errors report the same.
    const LOADER_LOG: &str = "XR_LOADER_DEBUG";
    if cfg!(feature = "xr") && std::env::var_os(LOADER_LOG).is_none() {
        set(LOADER_LOG, "none");
    }
    // SAFETY: while the library opens a device, other threads read the environment only through `std::env`, as the
    // caller promises.
    unsafe { let_devices_set_environment() };
}

/// Lets the library set the environment variables that a device reads while it opens.
///
/// # Safety
/// While a device opens, nothing else may access the environment except through [`mod@std::env`].
pub(super) unsafe fn let_devices_set_environment() {
    // SAFETY: the caller promises the same.
    unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
}
