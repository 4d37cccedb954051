//! Lists the adapters of the machine and selects the ones to open devices on.

use std::sync::{Mutex, PoisonError};

use super::choice::by_default;
use super::{DeviceError, DevicePool, Quirks, Traversal, TraversalChoice};

pub(super) const INSTALL_HINT: &str = "install a Vulkan driver (Debian or Ubuntu: `apt-get install mesa-vulkan-drivers`, \
     which brings a software one too), or update the graphics driver";

/// Maximum number of devices that one run drives: sets of devices are 64-bit masks.
pub(crate) const MAX_DEVICES: usize = 64;

/// Storage buffers per shader stage that a device must support: SVGF's accumulation binds the most.
pub(super) const STORAGE_BUFFERS_PER_STAGE: u32 = 13;
pub(super) const IMMEDIATE_BYTES: u32 = 64;

/// Oldest major release of Mesa whose software driver is known to be fast: it renders frames 1.3 to 2.5 times as fast
/// as the driver of Mesa 22.3.
const FAST_MESA: u32 = 25;

/// Description of an opened device.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DeviceInfo {
    /// Number of the device in the run, from 0.
    pub index: usize,
    /// Number of the adapter as listed by `diptych info`.
    pub adapter: usize,
    pub name: String,
    pub driver: String,
    pub kind: String,
    /// Worker threads of a software adapter, if the driver lets us set them.
    pub threads: Option<usize>,
    /// Ray traversal that the device uses.
    pub traversal: Traversal,
    /// Largest storage buffer that a shader can bind, bytes.
    pub max_storage_bytes: u64,
    /// Maximum error, in microseconds, of the device's timestamps after conversion to the host's clock.
    pub clock_residual_us: f64,
    /// Process that owns the device, in a run of several processes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rank: Option<RankName>,
}

impl DeviceInfo {
    /// Describes a device that was opened on this adapter, with the number 0 and traversal in compute shaders.
    pub(super) fn new(adapter: &wgpu::AdapterInfo, device: &wgpu::Device) -> Self {
        Self {
            index: 0,
            adapter: 0,
            name: adapter.name.clone(),
            driver: driver_name(adapter),
            kind: kind_name(adapter.device_type).to_owned(),
            threads: None,
            traversal: Traversal::Compute,
            max_storage_bytes: device.limits().max_storage_buffer_binding_size,
            clock_residual_us: 0.0,
            rank: None,
        }
    }

    /// Returns true if the device is on the first rank, which renders and gathers frames.
    pub fn is_on_first_rank(&self) -> bool {
        self.rank.as_ref().is_none_or(|rank| rank.number == 0)
    }
}

/// Rank of a process in a run of several, and its machine.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RankName {
    pub number: usize,
    pub host: String,
}

/// An adapter as `diptych info` lists it.
#[derive(Clone, Debug, serde::Serialize)]
pub struct AdapterReport {
    pub index: usize,
    pub name: String,
    pub driver: String,
    pub backend: String,
    pub kind: String,
    pub max_storage_mib: u64,
    pub max_storage_buffers: u32,
    pub timestamps: bool,
    /// True if the adapter supports hardware ray queries.
    pub ray_queries: bool,
    /// Requirements that the adapter lacks; empty if it can be used.
    pub missing: Vec<String>,
    pub hint: &'static str,
    /// Benefit of updating the driver, where one is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
    #[serde(skip)]
    pub(super) info: wgpu::AdapterInfo,
    #[serde(skip)]
    pub(super) quirks: Quirks,
}

/// Selection of the devices to open.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Adapter numbers. By default each hardware GPU once, or the first software adapter if there is no GPU.
    pub adapters: Option<Vec<usize>>,
    /// Devices per adapter.
    pub virtual_devices: usize,
    /// Largest number of devices per adapter, if the program opens several numbers one after another and compares them.
    /// Each number then has the same default of threads per device.
    pub most_virtual_devices: usize,
    /// Worker threads of each device on a software adapter: one number for all or one per device. The default is cores
    /// / devices, for the largest number of devices. For drivers that read the number from the environment, call
    /// [`super::set_environment_hook`] first: without a hook, the driver chooses the number, and a number here is an error.
    pub threads_per_device: Option<Vec<usize>>,
    pub traversal: TraversalChoice,
    /// Idle devices to use in place of new ones.
    pub pool: Option<DevicePool>,
}

/// Lock that is held while a device is created or adapters are listed: creation may change the environment, which
/// drivers read.
pub(super) static OPENING: Mutex<()> = Mutex::new(());

impl TraversalChoice {
    /// Resolves the choice for these adapters.
    ///
    /// # Errors
    /// [`DeviceError::NoRayQueries`] if hardware traversal is chosen and an adapter lacks ray queries.
    pub(super) fn on(self, adapters: &[&AdapterReport]) -> Result<Traversal, DeviceError> {
        let lacking = adapters.iter().find(|a| !a.ray_queries);
        match (self, lacking) {
            (Self::Compute, _) => Ok(Traversal::Compute),
            (Self::Hardware, None) => Ok(Traversal::Hardware),
            (Self::Hardware, Some(a)) => {
                Err(DeviceError::NoRayQueries { index: a.index, name: a.name.clone(), driver: a.driver.clone() })
            }
            // Ray queries of software drivers are no faster than our shaders, which traverse our own BVH; Mesa's are
            // five times slower.
            (Self::Auto, lacking) => {
                let is_fast = lacking.is_none() && adapters.iter().all(|a| a.kind.ends_with("GPU"));
                Ok(if is_fast { Traversal::Hardware } else { Traversal::Compute })
            }
        }
    }
}

pub(super) fn new_instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = if cfg!(target_os = "linux") { wgpu::Backends::VULKAN } else { wgpu::Backends::PRIMARY };
    descriptor.flags = instance_flags();
    wgpu::Instance::new(descriptor)
}

/// Returns the flags of the wgpu instance. They leave out the validation of indirect dispatches, which adds a compute
/// pass to each. It is not needed, since the shaders that write workgroup counts keep them within bounds.
pub(super) fn instance_flags() -> wgpu::InstanceFlags {
    if cfg!(debug_assertions) { wgpu::InstanceFlags::DEBUG } else { wgpu::InstanceFlags::empty() }
}

pub(super) fn enumerate(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()))
}

fn driver_name(info: &wgpu::AdapterInfo) -> String {
    format!("{} {}", info.driver, info.driver_info).trim().to_owned()
}

fn kind_name(kind: wgpu::DeviceType) -> &'static str {
    match kind {
        wgpu::DeviceType::DiscreteGpu => "discrete GPU",
        wgpu::DeviceType::IntegratedGpu => "integrated GPU",
        wgpu::DeviceType::VirtualGpu => "virtual GPU",
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::Other => "other",
    }
}

/// Names those of the `required` features, and of the limits, that an adapter or device lacks.
pub(super) fn missing(required: wgpu::Features, features: wgpu::Features, limits: &wgpu::Limits) -> Vec<String> {
    let mut missing = Vec::new();
    let lacking = required - features;
    if lacking.contains(wgpu::Features::IMMEDIATES) {
        missing.push("immediate (push) constants".to_owned());
    } else if limits.max_immediate_size < IMMEDIATE_BYTES {
        let bytes = limits.max_immediate_size;
        missing.push(format!("bytes of immediate (push) constants ({bytes} of {IMMEDIATE_BYTES})"));
    }
    if lacking.contains(wgpu::Features::TIMESTAMP_QUERY) {
        missing.push("timestamp queries".to_owned());
    }
    if limits.max_storage_buffers_per_shader_stage < STORAGE_BUFFERS_PER_STAGE {
        missing.push(format!(
            "storage buffers per stage ({} of {STORAGE_BUFFERS_PER_STAGE})",
            limits.max_storage_buffers_per_shader_stage
        ));
    }
    missing
}

/// Returns advice to update an old Mesa. Mesa puts its version first, as in `Mesa 22.3.6 (LLVM 15.0.6)`; development
/// versions end in letters.
fn advice(info: &wgpu::AdapterInfo) -> Option<String> {
    let version = info.driver_info.strip_prefix("Mesa ")?.split_whitespace().next()?;
    let major: u32 = version.split('.').next()?.parse().ok()?;
    let is_slow = info.device_type == wgpu::DeviceType::Cpu && major < FAST_MESA;
    is_slow.then(|| {
        format!(
            "Mesa {version} is old: frames are 1.3 to 2.5 times as fast with the software driver of Mesa {FAST_MESA}"
        )
    })
}

fn report(index: usize, adapter: &wgpu::Adapter) -> AdapterReport {
    let info = adapter.get_info();
    let advice = advice(&info);
    let missing = missing(Traversal::Compute.features(), adapter.features(), &adapter.limits());
    let hint = if missing.is_empty() { "" } else { "update its driver or choose another adapter" };
    let limits = adapter.limits();
    let quirks = Quirks::of(&info);
    AdapterReport {
        index,
        name: info.name.clone(),
        driver: driver_name(&info),
        backend: format!("{:?}", info.backend),
        kind: kind_name(info.device_type).to_owned(),
        max_storage_mib: limits.max_storage_buffer_binding_size >> 20,
        max_storage_buffers: limits.max_storage_buffers_per_shader_stage,
        timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
        ray_queries: adapter.features().contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY),
        missing,
        hint,
        advice,
        info,
        quirks,
    }
}

/// Returns all adapters of this machine.
pub fn adapters() -> Vec<AdapterReport> {
    let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
    enumerate(&new_instance()).iter().enumerate().map(|(i, a)| report(i, a)).collect()
}

/// Returns the ray traversal that devices of this selection would use.
///
/// # Errors
/// [`DeviceError::NoAdapter`], [`DeviceError::UnknownAdapter`], [`DeviceError::Lacks`] or
/// [`DeviceError::NoRayQueries`] if the selected adapters cannot be used.
pub fn chosen_traversal(selection: &Selection) -> Result<Traversal, DeviceError> {
    let found = adapters();
    traversal_of(&found, &choose(&found, selection)?, selection)
}

pub(super) fn traversal_of(
    found: &[AdapterReport],
    chosen: &[usize],
    selection: &Selection,
) -> Result<Traversal, DeviceError> {
    selection.traversal.on(&chosen.iter().map(|&index| &found[index]).collect::<Vec<_>>())
}

pub(super) fn choose(found: &[AdapterReport], selection: &Selection) -> Result<Vec<usize>, DeviceError> {
    if found.is_empty() {
        return Err(DeviceError::NoAdapter);
    }
    let chosen: Vec<usize> = match &selection.adapters {
        Some(numbers) => numbers.clone(),
        None => {
            let usable: Vec<&AdapterReport> = found.iter().filter(|a| a.missing.is_empty()).collect();
            let infos: Vec<_> = usable.iter().map(|a| &a.info).collect();
            let chosen: Vec<usize> = by_default(&infos).into_iter().map(|i| usable[i].index).collect();
            if chosen.is_empty() { vec![0] } else { chosen }
        }
    };
    for &index in &chosen {
        let adapter = found.get(index).ok_or(DeviceError::UnknownAdapter { index, last: found.len() - 1 })?;
        if !adapter.missing.is_empty() {
            let (name, missing) = (adapter.name.clone(), adapter.missing.join(", "));
            return Err(DeviceError::Lacks { index, name, missing, hint: adapter.hint });
        }
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::GpuDevice;
    use wgpu::DeviceType;

    #[test]
    fn missing_features_and_limits_are_named() {
        let (none, all) = (wgpu::Features::empty(), Traversal::Compute.features());
        let enough = GpuDevice::required_limits(wgpu::Limits::downlevel_defaults());
        assert_eq!(missing(all, all, &enough), [""; 0]);
        assert_eq!(missing(all, none, &enough), ["immediate (push) constants", "timestamp queries"]);
        assert_eq!(missing(GpuDevice::REQUIRED_FEATURES, none, &enough), ["immediate (push) constants"]);
        let limits = wgpu::Limits { max_storage_buffers_per_shader_stage: 4, max_immediate_size: 32, ..enough };
        let expected = ["bytes of immediate (push) constants (32 of 64)", "storage buffers per stage (4 of 13)"];
        assert_eq!(missing(all, all, &limits), expected);
    }

    #[test]
    fn old_software_drivers_get_advice() {
        let advice_on = |device_type, driver_info: &str| {
            let fake = wgpu::AdapterInfo::new(device_type, wgpu::Backend::Vulkan);
            advice(&wgpu::AdapterInfo { driver_info: driver_info.to_owned(), ..fake })
        };
        for (driver, old) in [
            ("Mesa 22.3.6 (LLVM 15.0.6)", Some("22.3.6")),
            ("Mesa 24.0.0-devel (git-0123456) (LLVM 17.0.6)", Some("24.0.0-devel")),
            ("Mesa 9.1", Some("9.1")),
            ("Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)", None),
            ("Mesa 100.0.0", None),
            ("Mesa", None),
            ("Mesa of old", None),
            ("1.2.3", None),
            ("", None),
        ] {
            let told = advice_on(DeviceType::Cpu, driver);
            assert_eq!(told.is_some(), old.is_some(), "{driver}: {told:?}");
            assert!(old.is_none_or(|v| told.unwrap().contains(&format!("Mesa {v} is old"))), "{driver}");
            // On GPUs, performance depends far less on the driver's version.
            assert_eq!(advice_on(DeviceType::DiscreteGpu, driver), None);
        }
    }
}
