//! Devices as they are opened.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::adapters::{
    AdapterReport, DeviceInfo, IMMEDIATE_BYTES, MAX_DEVICES, Selection, adapters, choose, enumerate, new_instance,
    traversal_of,
};
use super::{DeviceError, DeviceFailure, FailureKind, GpuDevice, Quirks, Traversal};

/// Held while a device is made, since the environment is the only way to tell Mesa its thread count.
pub(super) static OPENING: Mutex<()> = Mutex::new(());

/// Opens the selected devices, one after another: drivers have crashed on concurrent creation.
pub fn open(selection: &Selection) -> Result<Vec<GpuDevice>, DeviceError> {
    open_with(selection, |_| Ok(None))
}

/// [`open`], but for the first device, if `first` has one for it.
///
/// # Errors
/// Those of [`open`] and of `first`.
pub fn open_with(
    selection: &Selection,
    first: impl FnOnce(&Wanted<'_>) -> Result<Option<GpuDevice>, DeviceError>,
) -> Result<Vec<GpuDevice>, DeviceError> {
    let found = adapters();
    let chosen = choose(&found, selection)?;
    let traversal = traversal_of(&found, &chosen, selection)?;
    let each = selection.virtual_devices.max(1);
    let count = chosen.len() * each;
    if count > MAX_DEVICES {
        return Err(DeviceError::TooMany(count));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = match selection.threads_per_device.as_deref() {
        None => vec![cores / count; count],
        Some(&[all]) => vec![all; count],
        Some(each) if each.len() == count => each.to_vec(),
        Some(each) => return Err(DeviceError::ThreadCounts { given: each.len(), devices: count }),
    };
    let adapters = chosen.iter().flat_map(|&a| std::iter::repeat_n(a, each)).zip(threads);
    let mut first = Some(first);
    let open = |(index, (adapter, threads)): (usize, (usize, usize))| {
        let wanted = Wanted { index, adapter: &found[adapter], threads: threads.max(1), traversal };
        let given = first.take().map_or(Ok(None), |first| first(&wanted))?;
        given.map_or_else(|| open_one(&wanted), Ok)
    };
    adapters.enumerate().map(open).collect()
}

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
            required_features: self.traversal.features(),
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
fn open_one(wanted: &Wanted) -> Result<GpuDevice, DeviceError> {
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
