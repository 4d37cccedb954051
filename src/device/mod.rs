//! One device: adapters, virtual devices, pipelines and clocks.
//!
//! Every device, virtual ones included, is made from a wgpu instance of its own: on Mesa's lavapipe, devices of one
//! instance share one pool of worker threads and do not run side by side.

mod adapters;
mod checks;
mod choice;
mod clock;
mod environment;
mod failure;
mod opening;
#[cfg(feature = "xr")]
mod headset;
mod pipelines;
mod quirks;
#[cfg(feature = "view")]
mod screen;
mod traversal;

pub(crate) use adapters::MAX_DEVICES;
pub use adapters::{AdapterReport, DeviceInfo, RankName, Selection, adapters, chosen_traversal};
pub use checks::ShaderChecks;
pub use clock::GpuClock;
pub(crate) use clock::{MOST_DRIFT, Offset as ClockOffset};
pub use environment::set_environment_hook;
pub use failure::{DeviceFailure, FailureKind, panic_text};
#[cfg(feature = "xr")]
pub use headset::HeadsetDevice;
pub use opening::{Wanted, open, open_with};
pub use pipelines::{Pipeline, PipelineKey};
pub use quirks::{Quirks, Tables};
#[cfg(feature = "view")]
pub use screen::ScreenDevice;
pub use traversal::{Traversal, TraversalChoice};

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use failure::lost_on_panic;

#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    #[error("no graphics adapter was found: {}", adapters::INSTALL_HINT)]
    NoAdapter,
    #[error("there is no adapter {index}: `diptych devices` lists 0 to {last}")]
    UnknownAdapter { index: usize, last: usize },
    #[error("adapter {index} ({name}) lacks {missing}: {hint}")]
    Lacks { index: usize, name: String, missing: String, hint: &'static str },
    #[error(
        "adapter {index} ({name}, {driver}) has no ray queries, which hardware traversal is made of: let shaders traverse with --traversal compute, choose another adapter with --devices, or update its driver (Mesa's software driver has them in version 25)"
    )]
    NoRayQueries { index: usize, name: String, driver: String },
    #[error("adapter {index} ({name}) gave no device")]
    Open { index: usize, name: String, source: wgpu::RequestDeviceError },
    #[cfg(feature = "view")]
    #[error("cannot draw into the window")]
    Surface(#[from] wgpu::CreateSurfaceError),
    #[cfg(feature = "view")]
    #[error("no graphics adapter can draw into the window: {}", adapters::INSTALL_HINT)]
    NoScreen(#[from] wgpu::RequestAdapterError),
    #[cfg(feature = "xr")]
    #[error("the headset's runtime gave no device: {0}")]
    Headset(String),
    #[error("{0} devices are more than the 64 that one run can drive")]
    TooMany(usize),
    #[error("{given} thread counts for {devices} devices: give one per device, or one for all")]
    ThreadCounts { given: usize, devices: usize },
    #[error(
        "adapter {index} ({name}) reads its number of threads from the environment variable {}, which this program does not let the library set: ask for no number of threads, or provide device::set_environment_hook",
        environment::THREADS
    )]
    ThreadsUnsettable { index: usize, name: String },
}

/// A logical device with its queue. Polled from one thread at a time.
#[derive(Debug)]
pub struct GpuDevice {
    pub info: DeviceInfo,
    pub quirks: Quirks,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    /// How long [`Self::wait`] waits.
    pub patience: Duration,
    /// What was compiled on it, for all who use it one after another.
    pub pipelines: HashMap<PipelineKey, Pipeline>,
    failure: Arc<Mutex<Option<DeviceFailure>>>,
    /// Lives as long as the device.
    #[cfg_attr(not(feature = "view"), expect(dead_code))]
    instance: wgpu::Instance,
}

/// Waits are made of slices, so that the time in which the whole process stood still counts as one of them at most.
pub const WAIT_SLICES: u32 = 8;

/// How shaders of a device reach the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneAccess {
    pub tables: Tables,
    pub traversal: Traversal,
}

impl GpuDevice {
    pub fn scene_access(&self) -> SceneAccess {
        SceneAccess { tables: self.quirks.tables, traversal: self.info.traversal }
    }

    /// The same device for another thread, which uses it while this one does not.
    #[cfg(feature = "xr")]
    fn shared(&self) -> Self {
        Self {
            info: self.info.clone(),
            quirks: self.quirks,
            device: self.device.clone(),
            queue: self.queue.clone(),
            patience: self.patience,
            pipelines: HashMap::new(),
            failure: Arc::clone(&self.failure),
            instance: self.instance.clone(),
        }
    }

    /// How long a device may take for what is asked of it before the first frame: drivers compile every shader.
    pub const START_PATIENCE: Duration = Duration::from_secs(300);

    /// What went wrong on the device since it was opened, if anything did.
    pub fn failure(&self) -> Option<DeviceFailure> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What a driver says that has no memory left. Hosts that promise more memory than there is never come to say it, and
    /// what is refused for its size is another error.
    pub fn report_out_of_memory(&self) {
        let error = wgpu::Error::OutOfMemory { source: "injected".into() };
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error.into());
    }

    /// Whether the device has done everything up to `submission`.
    ///
    /// # Errors
    /// What went wrong on the device.
    pub fn has_ended(&self, submission: &wgpu::SubmissionIndex) -> Result<bool, DeviceFailure> {
        self.poll(Some(submission), Duration::ZERO)
    }

    /// Waits for everything submitted so far, or up to `submission`.
    ///
    /// # Errors
    /// What went wrong on the device, or that it took longer than its patience.
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), DeviceFailure> {
        for _ in 0..WAIT_SLICES {
            if self.poll(submission.as_ref(), self.patience / WAIT_SLICES)? {
                return Ok(());
            }
        }
        let what = format!("it did not end its work within {} ms", self.patience.as_millis());
        Err(DeviceFailure { kind: FailureKind::Hang, what })
    }

    /// The one place where the device is polled.
    fn poll(&self, submission: Option<&wgpu::SubmissionIndex>, limit: Duration) -> Result<bool, DeviceFailure> {
        let until = |submission_index, timeout| {
            let how = wgpu::PollType::Wait { submission_index, timeout: Some(timeout) };
            lost_on_panic(|| self.device.poll(how))
        };
        let polled = match until(submission.cloned(), limit) {
            Ok(Ok(_)) => Ok(true),
            Ok(Err(wgpu::PollError::Timeout)) => Ok(false),
            Ok(Err(error)) => {
                // A submission that was refused has no number; why it was comes once the queue is empty.
                let is_busy = || matches!(until(None, self.patience / WAIT_SLICES), Ok(Err(wgpu::PollError::Timeout)));
                let _ = (0..WAIT_SLICES).any(|_| !is_busy());
                Err(error.to_string().into())
            }
            Err(lost) => Err(lost),
        };
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        if let Err(new) = &polled {
            failure.get_or_insert_with(|| new.clone());
        }
        failure.clone().map_or(polled, Err)
    }
}
