//! Opens devices.

use std::sync::{Arc, PoisonError};

use super::adapters::{
    AdapterReport, DeviceInfo, IMMEDIATE_BYTES, MAX_DEVICES, OPENING, STORAGE_BUFFERS_PER_STAGE, Selection, adapters,
    choose, enumerate, missing, new_instance, traversal_of,
};
use super::{DeviceError, DeviceFailure, FailureKind, GpuDevice, Pipelines, Quirks, Traversal, environment};

/// Opens the selected devices, one after another: drivers have crashed on concurrent creation.
pub fn open(selection: &Selection) -> Result<Vec<GpuDevice>, DeviceError> {
    open_with(selection, |_| Ok(None))
}

/// Opens devices like [`open`], except that `first` may provide the first one.
///
/// # Errors
/// [`DeviceError`] if the selection is invalid or a device cannot be opened, and errors of `first`.
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
    let most = chosen.len() * each.max(selection.most_virtual_devices);
    let threads = match selection.threads_per_device.as_deref() {
        None => vec![None; count],
        Some(&[all]) => vec![Some(all); count],
        Some(each) if each.len() == count => each.iter().copied().map(Some).collect(),
        Some(each) => return Err(DeviceError::ThreadCounts { given: each.len(), devices: count }),
    };
    let adapters = chosen.iter().flat_map(|&a| std::iter::repeat_n(&found[a], each)).zip(threads);
    let wanted = |(index, (adapter, asked)): (usize, (_, Option<usize>))| {
        let threads = threads_to_tell(adapter, asked, cores / most, environment::is_settable())?;
        Ok(Wanted { index, adapter, threads, traversal })
    };
    let wanted = adapters.enumerate().map(wanted).collect::<Result<Vec<_>, DeviceError>>()?;
    let mut first = Some(first);
    let open = |wanted: &Wanted| {
        let given = first.take().map_or(Ok(None), |first| first(wanted))?;
        if let Some(gpu) = given {
            return Ok(gpu);
        }
        let pooled = selection.pool.as_ref().and_then(|pool| pool.take(|gpu| wanted.is_like(&gpu.info)));
        let mut gpu = pooled.map_or_else(|| open_one(wanted), Ok)?;
        gpu.info = DeviceInfo { index: wanted.index, clock_residual_us: 0.0, rank: None, ..gpu.info.clone() };
        gpu.pool.clone_from(&selection.pool);
        Ok(gpu)
    };
    wanted.iter().map(open).collect()
}

/// Returns the number of threads to set for an adapter's driver: the requested number `asked`, else `default`. Returns
/// `None` if the driver takes no number, or if no number was requested and the environment cannot be set.
fn threads_to_tell(
    adapter: &AdapterReport,
    asked: Option<usize>,
    default: usize,
    is_settable: bool,
) -> Result<Option<usize>, DeviceError> {
    match (adapter.quirks.threads_by_environment, asked) {
        (true, Some(_)) if !is_settable => {
            Err(DeviceError::ThreadsUnsettable { index: adapter.index, name: adapter.name.clone() })
        }
        (is_taken, asked) => Ok((is_taken && is_settable).then_some(asked.unwrap_or(default).max(1))),
    }
}

/// Description of a device to open.
pub struct Wanted<'a> {
    pub index: usize,
    pub(super) adapter: &'a AdapterReport,
    /// Number of threads to set for the driver of a software adapter.
    pub(super) threads: Option<usize>,
    pub(super) traversal: Traversal,
}

impl Wanted<'_> {
    /// True if an open device serves as this one.
    pub(super) fn is_like(&self, open: &DeviceInfo) -> bool {
        (open.adapter, open.threads, open.traversal) == (self.adapter.index, self.threads, self.traversal)
    }

    /// Sets the number of threads that Mesa reads when a device is created. The caller holds the lock [`OPENING`].
    pub(super) fn request_threads(&self) {
        if let Some(threads) = self.threads {
            // In lavapipe, the queue's thread executes the work itself if there are no worker threads. Request none
            // instead of one: a single worker and the queue's thread would alternate, and each dispatch would wake
            // both.
            environment::set_threads(if threads > 1 { threads } else { 0 });
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

    /// Wraps the opened wgpu device.
    pub(super) fn opened(&self, device: wgpu::Device, queue: wgpu::Queue) -> GpuDevice {
        let Self { index, adapter, threads, traversal } = *self;
        let about = DeviceInfo::new(&adapter.info, &device);
        let info = DeviceInfo { index, adapter: adapter.index, threads, traversal, ..about };
        watched(info, adapter.quirks, device, queue)
    }
}

/// Opens a device on its adapter.
fn open_one(wanted: &Wanted) -> Result<GpuDevice, DeviceError> {
    let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
    wanted.request_threads();
    let AdapterReport { index, ref name, .. } = *wanted.adapter;
    let adapter = enumerate(&new_instance()).into_iter().nth(index).ok_or(DeviceError::NoAdapter)?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wanted.descriptor(adapter.limits())))
        .map_err(|source| DeviceError::Open { index, name: name.clone(), source })?;
    Ok(wanted.opened(device, queue))
}

/// Wraps an opened device and registers callbacks that record its failure.
pub(super) fn watched(info: DeviceInfo, quirks: Quirks, device: wgpu::Device, queue: wgpu::Queue) -> GpuDevice {
    let gpu = wrapped(info, quirks, device, queue);
    let note = || {
        let failure = Arc::clone(&gpu.failure);
        move |what: DeviceFailure| {
            let mut known = failure.lock().unwrap_or_else(PoisonError::into_inner);
            // Calls on a lost device may report other errors before the loss itself is reported, so a loss replaces an
            // earlier error.
            if known
                .as_ref()
                .is_none_or(|k: &DeviceFailure| k.kind == FailureKind::Error && what.kind == FailureKind::Loss)
            {
                *known = Some(what);
            }
        }
    };
    let (lost, failed) = (note(), note());
    gpu.device.set_device_lost_callback(move |reason, message| {
        let what = format!("device lost ({reason:?}) {message}").trim_end().to_owned();
        lost(DeviceFailure { kind: FailureKind::Loss, what });
    });
    gpu.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| failed(error.into())));
    gpu
}

impl GpuDevice {
    /// Features that a device needs for the denoiser alone. Renderers also need timestamp queries.
    pub const REQUIRED_FEATURES: wgpu::Features = wgpu::Features::IMMEDIATES;

    /// Raises limits to those that a device needs. Images of more than 8 million pixels also need larger buffers than
    /// by default.
    pub fn required_limits(limits: wgpu::Limits) -> wgpu::Limits {
        wgpu::Limits {
            max_immediate_size: limits.max_immediate_size.max(IMMEDIATE_BYTES),
            max_storage_buffers_per_shader_stage: limits
                .max_storage_buffers_per_shader_stage
                .max(STORAGE_BUFFERS_PER_STAGE),
            ..limits
        }
    }

    /// Wraps a device that you have opened, for [`FrameDenoiser::on`](crate::denoise::FrameDenoiser::on). Devices and
    /// queues are handles, so pass clones. Request [`Self::REQUIRED_FEATURES`] and [`Self::required_limits`] for it.
    ///
    /// Its callbacks for a lost device and for uncaptured errors remain yours, and receive errors of the denoiser's work
    /// such as a lack of memory. Without a callback, wgpu panics. [`Self::failure`] knows only failures that a wait for the
    /// device returned.
    ///
    /// # Errors
    /// [`DeviceError::GivenLacks`] names the features and limits that the device lacks.
    pub fn from_wgpu(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, DeviceError> {
        let adapter = device.adapter_info();
        let missing = missing(Self::REQUIRED_FEATURES, device.features(), &device.limits());
        if !missing.is_empty() {
            return Err(DeviceError::GivenLacks { name: adapter.name, missing: missing.join(", ") });
        }
        Ok(wrapped(DeviceInfo::new(&adapter, &device), Quirks::of(&adapter), device, queue))
    }
}

/// Wraps an opened device whose callbacks belong to the caller.
fn wrapped(info: DeviceInfo, quirks: Quirks, device: wgpu::Device, queue: wgpu::Queue) -> GpuDevice {
    let (patience, pipelines) = (GpuDevice::START_PATIENCE, Pipelines::default());
    GpuDevice { info, quirks, device, queue, patience, pipelines, failure: Arc::default(), pool: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::traversal::tests::adapter;

    #[test]
    fn thread_count_is_set_only_by_the_hook() {
        let gpu = adapter("discrete GPU", true);
        let quirks = Quirks { threads_by_environment: true, ..Quirks::default() };
        let lavapipe = AdapterReport { quirks, ..adapter("software", false) };
        for (asked, with_hook) in [(None, 4), (Some(3), 3), (Some(0), 1)] {
            for is_settable in [false, true] {
                assert_eq!(threads_to_tell(&gpu, asked, 4, is_settable).unwrap(), None);
            }
            assert_eq!(threads_to_tell(&lavapipe, asked, 4, true).unwrap(), Some(with_hook));
            match threads_to_tell(&lavapipe, asked, 4, false) {
                Ok(told) => assert_eq!((asked, told), (None, None)),
                Err(error) => {
                    assert!(asked.is_some());
                    assert!(error.to_string().contains("LP_NUM_THREADS"), "{error}");
                }
            }
        }
    }

    /// Tests of the library install no hook.
    #[test]
    fn rejects_thread_counts_without_a_hook() {
        let before = std::env::var_os(environment::THREADS);
        for AdapterReport { index, .. } in adapters().iter().filter(|a| a.quirks.threads_by_environment) {
            let asking = |threads_per_device| {
                open(&Selection { adapters: Some(vec![*index]), threads_per_device, ..Selection::default() })
            };
            let refused = asking(Some(vec![1])).expect_err("it cannot be told");
            assert!(refused.to_string().contains("LP_NUM_THREADS"), "{refused}");
            assert_eq!(asking(None).expect("it chooses by itself")[0].info.threads, None);
        }
        assert_eq!(std::env::var_os(environment::THREADS), before);
    }
}
