//! Why a device cannot be used any longer.

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum FailureKind {
    /// It is gone, with all that it held.
    Loss,
    /// It did not answer in time.
    Hang,
    /// It had no memory left.
    Oom,
    /// It, or the code that drives it, reported another error.
    Error,
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DeviceFailure {
    pub kind: FailureKind,
    /// In words.
    pub what: String,
}

impl fmt::Display for DeviceFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)
    }
}

impl From<String> for DeviceFailure {
    fn from(what: String) -> Self {
        Self { kind: FailureKind::Error, what }
    }
}

impl From<wgpu::Error> for DeviceFailure {
    fn from(error: wgpu::Error) -> Self {
        let kind = match error {
            wgpu::Error::OutOfMemory { .. } => FailureKind::Oom,
            wgpu::Error::Validation { .. } | wgpu::Error::Internal { .. } => FailureKind::Error,
        };
        // wgpu sets its chain of causes in lines.
        let what: Vec<_> = error.to_string().lines().map(|l| l.trim().to_owned()).filter(|l| !l.is_empty()).collect();
        Self { kind, what: what.join(" ") }
    }
}

/// What a call returns that panics where the driver has lost the device, as [`wgpu::Device::poll`] does.
pub(super) fn lost_on_panic<T>(call: impl FnOnce() -> T) -> Result<T, DeviceFailure> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
        let what = panic_text(&*panic).split_whitespace().collect::<Vec<_>>().join(" ");
        DeviceFailure { kind: FailureKind::Loss, what: format!("device lost: {what}") }
    })
}

/// What a panic says.
pub fn panic_text(panic: &(dyn Any + Send)) -> &str {
    panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_that_panics_has_lost_the_device() {
        assert_eq!(lost_on_panic(|| 7), Ok(7));
        let lost = lost_on_panic(|| -> u32 { panic!("Error in Device::poll:\n  Parent device is lost\n") });
        let what = "device lost: Error in Device::poll: Parent device is lost".to_owned();
        assert_eq!(lost, Err(DeviceFailure { kind: FailureKind::Loss, what }));
    }
}
