//! Failures after which a device cannot be used any longer.

use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum FailureKind {
    /// The device was lost, with everything on it.
    Loss,
    /// It did not respond in time.
    Hang,
    /// It ran out of memory.
    Oom,
    /// Another error of the device or of its driver.
    Error,
}

impl FailureKind {
    /// Returns the kind as `run.json` spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Loss => "loss",
            Self::Hang => "hang",
            Self::Oom => "oom",
            Self::Error => "error",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DeviceFailure {
    pub kind: FailureKind,
    /// Human-readable description.
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
        // wgpu prints the chain of causes on separate lines.
        let what: Vec<_> = error.to_string().lines().map(|l| l.trim().to_owned()).filter(|l| !l.is_empty()).collect();
        Self { kind, what: what.join(" ") }
    }
}

/// Runs a call that panics if the driver has lost the device, like [`wgpu::Device::poll`], and converts the panic to a
/// loss.
pub(super) fn lost_on_panic<T>(call: impl FnOnce() -> T) -> Result<T, DeviceFailure> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
        let what = panic_text(&*panic).split_whitespace().collect::<Vec<_>>().join(" ");
        DeviceFailure { kind: FailureKind::Loss, what: format!("device lost: {what}") }
    })
}

/// Returns the message of a panic.
pub fn panic_text(panic: &(dyn Any + Send)) -> &str {
    panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panicking_call_counts_as_device_loss() {
        assert_eq!(lost_on_panic(|| 7), Ok(7));
        let lost = lost_on_panic(|| -> u32 { panic!("Error in Device::poll:\n  Parent device is lost\n") });
        let what = "device lost: Error in Device::poll: Parent device is lost".to_owned();
        assert_eq!(lost, Err(DeviceFailure { kind: FailureKind::Loss, what }));
    }
}
