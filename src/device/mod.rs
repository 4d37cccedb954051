//! One device: adapters, virtual devices, shaders and clocks.
//!
//! Every device, virtual ones included, is made from a wgpu instance of its own: on Mesa's lavapipe, devices of one
//! instance share one pool of worker threads and do not run side by side.

mod adapters;
mod clock;
mod shader;

pub use adapters::{AdapterReport, DeviceInfo, Selection, adapters, open};
pub use clock::GpuClock;
#[cfg(test)]
pub(crate) use shader::expand;
pub use shader::{ShaderChecks, override_names, wgsl};

use std::sync::{Arc, Mutex, PoisonError};

#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    #[error("no graphics adapter was found: {}", adapters::INSTALL_HINT)]
    NoAdapter,
    #[error("there is no adapter {index}: `diptych devices` lists 0 to {last}")]
    UnknownAdapter { index: usize, last: usize },
    #[error("adapter {index} ({name}) lacks {missing}: {hint}")]
    Lacks { index: usize, name: String, missing: String, hint: &'static str },
    #[error("adapter {index} ({name}) gave no device")]
    Open { index: usize, name: String, source: wgpu::RequestDeviceError },
    #[error("{0} devices are more than the 64 that one run can drive")]
    TooMany(usize),
}

/// A logical device with its queue. Polled from one thread only.
#[derive(Debug)]
pub struct GpuDevice {
    pub info: DeviceInfo,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    failure: Arc<Mutex<Option<String>>>,
    _instance: wgpu::Instance,
}

impl GpuDevice {
    /// What went wrong on the device since it was opened, if anything did.
    pub fn failure(&self) -> Option<String> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits for everything submitted so far, or up to `submission`.
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), String> {
        let wait = wgpu::PollType::Wait { submission_index: submission, timeout: None };
        self.device.poll(wait).map_err(|e| e.to_string())?;
        self.failure().map_or(Ok(()), Err)
    }
}
