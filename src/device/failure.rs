//! Why a device cannot be used any longer.

use std::fmt;

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
