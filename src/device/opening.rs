//! Devices as they are opened.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::adapters::{AdapterReport, DeviceInfo, IMMEDIATE_BYTES, enumerate, new_instance};
use super::{DeviceError, DeviceFailure, FailureKind, GpuDevice, Quirks, Traversal};

/// Held while a device is made, since the environment is the only way to tell Mesa its thread count.
pub(super) static OPENING: Mutex<()> = Mutex::new(());

/// How a device is to be opened.
pub struct Wanted<'a> {
    pub index: usize,
    pub(super) adapter: &'a AdapterReport,
    /// Of a software adapter.
    pub(super) threads: usize,
    pub(super) traversal: Traversal,
}

impl Wanted<'_> {
    /// Tells Mesa how many threads, which it reads while a device is made; under the lock of [`OPENING`].
    pub(super) fn tell_threads(&self) {
        if self.adapter.quirks.threads_by_environment {
            // A queue has a thread of its own, which does the work where there is no other. One other would take turns with
            // it, and each dispatch would wake both.
            let others = if self.threads > 1 { self.threads } else { 0 };
            // SAFETY: this happens under the lock; nothing else in this program reads or writes the environment from
            // another thread at that time.
            unsafe { std::env::set_var("LP_NUM_THREADS", others.to_string()) };
        }
    }

    pub(super) fn descriptor(&self, limits: wgpu::Limits) -> wgpu::DeviceDescriptor<'static> {
        wgpu::DeviceDescriptor {
            label: Some("diptych"),
            required_features: wgpu::Features::IMMEDIATES | wgpu::Features::TIMESTAMP_QUERY | self.traversal.features(),
            required_limits: wgpu::Limits { max_immediate_size: IMMEDIATE_BYTES, ..limits },
            experimental_features: self.traversal.experiments(),
            ..Default::default()
        }
    }

    /// The device that was opened for it.
    pub(super) fn opened(&self, device: wgpu::Device, queue: wgpu::Queue, instance: wgpu::Instance) -> GpuDevice {
        let AdapterReport { index, name, driver, kind, quirks, .. } = self.adapter;
        let info = DeviceInfo {
            index: self.index,
            adapter: *index,
            name: name.clone(),
            driver: driver.clone(),
            kind: kind.clone(),
            threads: quirks.threads_by_environment.then_some(self.threads),
            traversal: self.traversal,
            max_storage_bytes: device.limits().max_storage_buffer_binding_size,
            clock_residual_us: 0.0,
            rank: None,
        };
        watched(info, *quirks, device, queue, instance)
    }
}

/// Opens a device on its adapter.
pub(super) fn open_one(wanted: &Wanted) -> Result<GpuDevice, DeviceError> {
    let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
    wanted.tell_threads();
    let AdapterReport { index, ref name, .. } = *wanted.adapter;
    let instance = new_instance();
    let adapter = enumerate(&instance).into_iter().nth(index).ok_or(DeviceError::NoAdapter)?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wanted.descriptor(adapter.limits())))
        .map_err(|source| DeviceError::Open { index, name: name.clone(), source })?;
    Ok(wanted.opened(device, queue, instance))
}

/// Notes what goes wrong on the device from here on.
pub(super) fn watched(
    info: DeviceInfo,
    quirks: Quirks,
    device: wgpu::Device,
    queue: wgpu::Queue,
    instance: wgpu::Instance,
) -> GpuDevice {
    let failure = Arc::new(Mutex::new(None));
    let note = |failure: &Arc<Mutex<Option<DeviceFailure>>>| {
        let failure = Arc::clone(failure);
        move |what: DeviceFailure| {
            let mut known = failure.lock().unwrap_or_else(PoisonError::into_inner);
            // What is asked of a lost device fails as well, perhaps before the loss is told.
            if known
                .as_ref()
                .is_none_or(|k: &DeviceFailure| k.kind == FailureKind::Error && what.kind == FailureKind::Loss)
            {
                *known = Some(what);
            }
        }
    };
    let (lost, failed) = (note(&failure), note(&failure));
    device.set_device_lost_callback(move |reason, message| {
        let what = format!("device lost ({reason:?}) {message}").trim_end().to_owned();
        lost(DeviceFailure { kind: FailureKind::Loss, what });
    });
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| failed(error.into())));
    let (patience, pipelines) = (GpuDevice::START_PATIENCE, HashMap::new());
    GpuDevice { info, quirks, device, queue, patience, pipelines, failure, instance }
}
