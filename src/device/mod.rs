//! Devices: adapters, virtual devices, pipelines and clocks.
//!
//! Every device, virtual ones included, has its own wgpu instance: on Mesa's lavapipe, devices of one instance share a
//! pool of worker threads and do not run concurrently.

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
mod pool;
mod quirks;
#[cfg(feature = "view")]
mod screen;
pub(crate) mod staging;
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
pub use pipelines::{Pipeline, PipelineKey, Pipelines};
pub use pool::DevicePool;
pub use quirks::{Quirks, Tables};
#[cfg(feature = "view")]
pub use screen::ScreenDevice;
pub use traversal::{Traversal, TraversalChoice};

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use failure::lost_on_panic;

#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    #[error("no graphics adapter was found: {}", adapters::INSTALL_HINT)]
    NoAdapter,
    #[error("there is no adapter {index}: `diptych info` lists 0 to {last}")]
    UnknownAdapter { index: usize, last: usize },
    #[error("adapter {index} ({name}) lacks {missing}: {hint}")]
    Lacks { index: usize, name: String, missing: String, hint: &'static str },
    #[error(
        "adapter {index} ({name}, {driver}) has no ray queries, which hardware traversal needs: update its driver (Mesa's software driver has them in version 25), or choose compute traversal or another adapter"
    )]
    NoRayQueries { index: usize, name: String, driver: String },
    #[error(
        "the device on {name} lacks {missing}: request GpuDevice::REQUIRED_FEATURES and GpuDevice::required_limits when you open it"
    )]
    GivenLacks { name: String, missing: String },
    #[error("cannot open a device on adapter {index} ({name})")]
    Open { index: usize, name: String, source: wgpu::RequestDeviceError },
    #[cfg(feature = "view")]
    #[error("cannot draw into the window")]
    Surface(#[from] wgpu::CreateSurfaceError),
    #[cfg(feature = "view")]
    #[error("no graphics adapter can draw into the window: {}", adapters::INSTALL_HINT)]
    NoScreen(#[from] wgpu::RequestAdapterError),
    #[cfg(feature = "xr")]
    #[error("cannot open a device for the headset's OpenXR runtime: {0}")]
    Headset(String),
    #[error("{0} devices are requested, but one run can drive at most 64")]
    TooMany(usize),
    #[error("{given} thread counts for {devices} devices: give one per device, or one for all")]
    ThreadCounts { given: usize, devices: usize },
    #[error(
        "adapter {index} ({name}) reads its thread count from the environment variable {}, which this program does not let the library set: request no thread count, or install a hook with device::set_environment_hook",
        environment::THREADS
    )]
    ThreadsUnsettable { index: usize, name: String },
}

/// A logical device with its queue. One thread polls it at a time.
#[derive(Debug)]
pub struct GpuDevice {
    pub info: DeviceInfo,
    pub quirks: Quirks,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    /// Timeout of [`Self::wait`].
    pub patience: Duration,
    pub pipelines: Pipelines,
    failure: Arc<Mutex<Option<DeviceFailure>>>,
    /// Pool that the device returns to.
    pool: Option<DevicePool>,
}

/// Number of slices that a wait is divided into. If the whole process is suspended, at most one slice is lost.
pub const WAIT_SLICES: u32 = 8;

/// Resource from which a device's shaders read the scene's tables, and their method of ray traversal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneAccess {
    pub tables: Tables,
    pub traversal: Traversal,
}

impl GpuDevice {
    pub fn scene_access(&self) -> SceneAccess {
        SceneAccess { tables: self.quirks.tables, traversal: self.info.traversal }
    }

    /// Returns the same device for another user, which may have work on it only while no other user has.
    pub(crate) fn shared(&self) -> Self {
        Self {
            info: self.info.clone(),
            quirks: self.quirks,
            device: self.device.clone(),
            queue: self.queue.clone(),
            patience: self.patience,
            pipelines: self.pipelines.clone(),
            failure: Arc::clone(&self.failure),
            pool: None,
        }
    }

    /// Timeout before the first frame, while drivers compile every shader.
    pub const START_PATIENCE: Duration = Duration::from_secs(300);

    /// Creates a buffer of `size` bytes.
    pub(crate) fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let label = Some(label);
        self.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation: false })
    }

    /// Creates a buffer with these contents. If the device has failed, it stays empty.
    pub(crate) fn filled(&self, label: &str, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.buffer(label, contents.len() as u64, usage | wgpu::BufferUsages::COPY_DST);
        self.queue.write_buffer(&buffer, 0, contents);
        buffer
    }

    /// Creates a buffer with these contents, from which commands copy.
    pub(crate) fn staged(&self, contents: impl ExactSizeIterator<Item = [u8; 16]>) -> wgpu::Buffer {
        let (size, usage) = (16 * contents.len() as u64, wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC);
        let descriptor = wgpu::BufferDescriptor { label: Some("staged"), size, usage, mapped_at_creation: true };
        let buffer = self.device.create_buffer(&descriptor);
        // It cannot be mapped if the device has failed, which is reported otherwise.
        if let Ok(mut view) = buffer.get_mapped_range_mut(..) {
            view.slice(..).into_chunks().0.write_iter(contents);
        }
        buffer.unmap();
        buffer
    }

    /// Creates queries for `count` timestamps.
    pub(crate) fn timestamps(&self, label: &str, count: u32) -> wgpu::QuerySet {
        let (label, ty) = (Some(label), wgpu::QueryType::Timestamp);
        self.device.create_query_set(&wgpu::QuerySetDescriptor { label, ty, count })
    }

    /// Returns the failure of the device since it was opened, if any.
    pub fn failure(&self) -> Option<DeviceFailure> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Fails the device as if its driver had reported that it is out of memory. Fault injection needs this, since the
    /// error is hard to provoke: hosts that overcommit memory never report it, and a single allocation that is refused
    /// for its size gives a different error.
    pub fn report_out_of_memory(&self) {
        let error = wgpu::Error::OutOfMemory { source: "injected".into() };
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error.into());
    }

    /// Returns true if the device has completed everything up to `submission`.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device has failed.
    pub fn has_ended(&self, submission: &wgpu::SubmissionIndex) -> Result<bool, DeviceFailure> {
        self.poll(Some(submission), Duration::ZERO)
    }

    /// Waits for everything submitted so far, or up to `submission`.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device has failed; its kind is [`FailureKind::Hang`] if the wait exceeds
    /// [`Self::patience`].
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), DeviceFailure> {
        for _ in 0..WAIT_SLICES {
            if self.poll(submission.as_ref(), self.patience / WAIT_SLICES)? {
                return Ok(());
            }
        }
        let what = format!("it did not end its work within {} ms", self.patience.as_millis());
        Err(DeviceFailure { kind: FailureKind::Hang, what })
    }

    /// Polls the device. All polling goes through this function.
    fn poll(&self, submission: Option<&wgpu::SubmissionIndex>, limit: Duration) -> Result<bool, DeviceFailure> {
        let until = |submission_index, timeout| {
            let how = wgpu::PollType::Wait { submission_index, timeout: Some(timeout) };
            lost_on_panic(|| self.device.poll(how))
        };
        let polled = match until(submission.cloned(), limit) {
            Ok(Ok(_)) => Ok(true),
            Ok(Err(wgpu::PollError::Timeout)) => Ok(false),
            Ok(Err(error)) => {
                // wgpu knows no index of a submission that it rejected. It reports the reason for the rejection once
                // the queue is empty, so wait for that.
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
