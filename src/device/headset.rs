//! Opens the device from which a headset's runtime takes images, as the runtime requires. This is the only code that
//! calls Vulkan directly instead of through wgpu.
//!
//! With `XR_KHR_vulkan_enable2` the runtime creates the instance and the device from the program's create infos and
//! adds the extensions that it needs. wgpu then adopts both, with the extensions that it requested itself.

use std::ffi::{CStr, c_char, c_void};
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk::{self, Handle};
use openxr::vulkan::SessionCreateInfo;
use openxr::{FrameStream, FrameWaiter, Session, Swapchain, SystemId, Vulkan};
use wgpu::hal;

use super::adapters::{OPENING, instance_flags};
use super::opening::Wanted;
use super::screen::watched_screen;
use super::{DeviceError, GpuDevice};

/// Newest Vulkan version that wgpu knows.
const VULKAN: u32 = vk::API_VERSION_1_3;

type LoadVulkan = unsafe extern "system" fn(*const c_void, *const c_char) -> Option<unsafe extern "system" fn()>;

/// Device from which the headset's runtime takes images. It either is the first rendering device, or only receives
/// images from the rendering devices.
#[derive(Debug)]
pub struct HeadsetDevice {
    pub gpu: GpuDevice,
    renders: bool,
    binding: Binding,
}

/// Vulkan handles of the instance, the physical device and the device, and the queue family.
#[derive(Clone, Copy, Debug)]
struct Binding {
    instance: u64,
    physical: u64,
    device: u64,
    family: u32,
}

/// Returns a function that converts an error to [`DeviceError::Headset`]; `what` says which call failed.
fn failed<E: std::fmt::Display>(what: &'static str) -> impl FnOnce(E) -> DeviceError {
    move |error| DeviceError::Headset(format!("{what}: {error}"))
}

impl HeadsetDevice {
    /// Opens the device. `first` describes the first rendering device. If its adapter is the one that the runtime
    /// requires, the opened device is also used for rendering.
    ///
    /// # Errors
    /// [`DeviceError::Headset`] if a call of the runtime or the driver fails, [`DeviceError::Open`] if wgpu cannot
    /// create its device.
    pub fn open(xr: &openxr::Instance, system: SystemId, first: &Wanted) -> Result<Self, DeviceError> {
        let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        first.request_threads();
        // SAFETY: the library that `load` opens is the system's Vulkan loader.
        let entry = unsafe { ash::Entry::load() }.map_err(failed("cannot load the Vulkan loader"))?;
        let (instance, version, extensions) = Self::instance(&entry, xr, system)?;
        let raw = (instance.handle().as_raw(), instance.clone());
        // SAFETY: the instance was created from this entry with this version and with these extensions, which are all
        // that wgpu requests there. wgpu destroys it when the last object created from it is dropped; the runtime does
        // not.
        let instance = unsafe {
            let thresholds = wgpu::MemoryBudgetThresholds::default();
            hal::vulkan::Instance::from_raw(
                entry.clone(),
                instance,
                version,
                0,
                None,
                extensions,
                instance_flags(),
                thresholds,
                false,
                None,
            )
        }
        .map_err(failed("wgpu cannot use its Vulkan instance"))?;
        // SAFETY: the runtime created this instance.
        let physical = unsafe { xr.vulkan_graphics_device(system, raw.0 as *const c_void) }
            .map_err(failed("cannot query its graphics adapter"))?;
        let physical = vk::PhysicalDevice::from_raw(physical as u64);
        let exposed = instance
            .expose_adapter(physical)
            .ok_or_else(|| DeviceError::Headset("its graphics adapter is too old".to_owned()))?;
        let described = exposed.info.clone();
        let limits = exposed.capabilities.limits.clone();
        let renders = described == first.adapter.info;
        let descriptor = if renders {
            first.descriptor(limits)
        } else {
            let label = Some("diptych headset");
            wgpu::DeviceDescriptor { label, required_limits: limits, ..Default::default() }
        };
        let features = descriptor.required_features;
        // SAFETY: the adapter was just enumerated.
        let families = unsafe { raw.1.get_physical_device_queue_family_properties(physical) };
        let family = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::GRAPHICS));
        let family = family.ok_or_else(|| DeviceError::Headset("its adapter has no graphics queue".to_owned()))? as u32;
        let extensions = exposed.adapter.required_device_extensions(features);
        let device = Self::device(&entry, xr, system, &raw.1, &exposed, (&extensions, features), family)?;
        let handle = device.handle().as_raw();
        // SAFETY: the device was created from this adapter with these extensions, the features that belong to them, and
        // one queue of this family. wgpu destroys it when the last object created from it is dropped.
        let open = unsafe {
            let hints = wgpu::MemoryHints::default();
            let limits = &descriptor.required_limits;
            exposed.adapter.device_from_raw(device, None, &extensions, features, limits, &hints, family, 0)
        }
        .map_err(failed("wgpu cannot use its Vulkan device"))?;
        // SAFETY: the instance is complete, and nothing else owns it.
        let instance = unsafe { wgpu::Instance::from_hal::<hal::api::Vulkan>(instance) };
        // SAFETY: the adapter was created from this instance.
        let adapter = unsafe { instance.create_adapter_from_hal(exposed) };
        // SAFETY: the device was created from this adapter, with these features.
        let (device, queue) = unsafe { adapter.create_device_from_hal(open, &descriptor) }
            .map_err(|source| DeviceError::Open { index: 0, name: described.name.clone(), source })?;
        let binding = Binding { instance: raw.0, physical: physical.as_raw(), device: handle, family };
        let gpu = if renders { first.opened(device, queue) } else { watched_screen(described, device, queue) };
        Ok(Self { gpu, renders, binding })
    }

    pub fn renders(&self) -> bool {
        self.renders
    }

    /// Returns the device for use as a renderer's first device, if it renders. Do not use the headset and its frames
    /// while a frame is being rendered: both use one queue.
    pub fn renderer(&self) -> Option<GpuDevice> {
        self.renders.then(|| self.gpu.shared())
    }

    /// Lets the runtime create the instance; returns it with the Vulkan version of the loader and with the extensions
    /// that wgpu requested.
    fn instance(
        entry: &ash::Entry,
        xr: &openxr::Instance,
        system: SystemId,
    ) -> Result<(ash::Instance, u32, Vec<&'static CStr>), DeviceError> {
        let required = xr.graphics_requirements::<Vulkan>(system).map_err(failed("cannot query its requirements"))?;
        // SAFETY: the loader has been loaded.
        let version = unsafe { entry.try_enumerate_instance_version() }
            .map_err(failed("cannot query the Vulkan version"))?
            .unwrap_or(vk::API_VERSION_1_0);
        let asked = required.min_api_version_supported;
        let asked_vk = vk::make_api_version(0, asked.major().into(), asked.minor().into(), 0);
        if asked_vk > version.min(VULKAN) {
            return Err(DeviceError::Headset(format!("it requires Vulkan {asked}, which the loader or wgpu lacks")));
        }
        let extensions = hal::vulkan::Instance::desired_extensions(entry, version, instance_flags())
            .map_err(failed("cannot list the Vulkan instance extensions"))?;
        let names: Vec<*const c_char> = extensions.iter().map(|name| name.as_ptr()).collect();
        let about = vk::ApplicationInfo::default()
            .application_name(c"diptych")
            .engine_name(c"wgpu-hal")
            .api_version(if version < vk::API_VERSION_1_1 { vk::API_VERSION_1_0 } else { VULKAN });
        let info = vk::InstanceCreateInfo::default().application_info(&about).enabled_extension_names(&names);
        // SAFETY: the create info and everything it points to outlive the call, and everything it requests is
        // available.
        let raw = unsafe {
            let info = std::ptr::from_ref(&info).cast();
            xr.create_vulkan_instance(system, load_function(entry), info)
        }
        .map_err(failed("it cannot create a Vulkan instance"))?
        .map_err(|result| failed("it cannot create a Vulkan instance")(vk::Result::from_raw(result)))?;
        // SAFETY: this loader created the instance with that handle.
        let instance = unsafe { ash::Instance::load(entry.static_fn(), vk::Instance::from_raw(raw as u64)) };
        Ok((instance, version, extensions))
    }

    /// Lets the runtime create the device.
    fn device(
        entry: &ash::Entry,
        xr: &openxr::Instance,
        system: SystemId,
        instance: &ash::Instance,
        exposed: &hal::ExposedAdapter<hal::api::Vulkan>,
        (extensions, features): (&[&'static CStr], wgpu::Features),
        family: u32,
    ) -> Result<ash::Device, DeviceError> {
        let mut features = exposed.adapter.physical_device_features(extensions, features);
        let names: Vec<*const c_char> = extensions.iter().map(|name| name.as_ptr()).collect();
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(family)
            .queue_priorities(std::slice::from_ref(&1.0))];
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
        let info = features.add_to_device_create(info);
        let physical = exposed.adapter.raw_physical_device().as_raw();
        // SAFETY: the create info and everything it points to outlive the call, and it requests only features of the
        // adapter.
        let raw = unsafe {
            let info = std::ptr::from_ref(&info).cast();
            xr.create_vulkan_device(system, load_function(entry), physical as *const c_void, info)
        }
        .map_err(failed("it cannot create a Vulkan device"))?
        .map_err(|result| failed("it cannot create a Vulkan device")(vk::Result::from_raw(result)))?;
        // SAFETY: this instance created the device with that handle.
        Ok(unsafe { ash::Device::load(instance.fp_v1_0(), vk::Device::from_raw(raw as u64)) })
    }

    /// Creates a session that shows images of this device.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn session(
        &self,
        xr: &openxr::Instance,
        system: SystemId,
    ) -> Result<(Session<Vulkan>, FrameWaiter, FrameStream<Vulkan>), openxr::sys::Result> {
        let Binding { instance, physical, device, family } = self.binding;
        let info = SessionCreateInfo {
            instance: instance as *const c_void,
            physical_device: physical as *const c_void,
            device: device as *const c_void,
            queue_family_index: family,
            queue_index: 0,
        };
        // The session drops the guard last, so the wgpu device and queue outlive the session.
        let guard = Box::new((self.gpu.queue.clone(), self.gpu.device.clone()));
        // SAFETY: the handles are valid until the guard is dropped. One thread at a time uses the queue: the thread
        // that owns the headset makes the session's calls, since neither the headset nor its frames are given to
        // another thread. If a worker renders with this device, the owning thread waits for that worker from the begin
        // of a frame to its end. A worker without a frame does not use the queue.
        unsafe { xr.create_session_with_guard::<Vulkan>(system, &info, guard) }
    }

    /// Wraps all `images` of a swapchain of this device's session as textures. The swapchain lives as long as any of
    /// them. `state` is the state in which the runtime hands them over for drawing.
    ///
    /// # Errors
    /// [`DeviceError::Headset`] if the device is not a Vulkan device.
    pub fn textures(
        &self,
        swapchain: &Arc<Mutex<Swapchain<Vulkan>>>,
        images: Vec<u64>,
        descriptor: &wgpu::TextureDescriptor,
        state: wgpu::TextureUses,
    ) -> Result<Vec<wgpu::Texture>, DeviceError> {
        let texture = |image: u64| {
            let own = hal::TextureDescriptor {
                label: descriptor.label,
                size: descriptor.size,
                mip_level_count: descriptor.mip_level_count,
                sample_count: descriptor.sample_count,
                dimension: descriptor.dimension,
                format: descriptor.format,
                usage: state,
                memory_flags: hal::MemoryFlags::empty(),
                view_formats: descriptor.view_formats.to_vec(),
            };
            let keeps = Arc::clone(swapchain);
            // SAFETY: the image belongs to the swapchain that was created as described, with memory of the runtime. It
            // is valid as long as the swapchain, which wgpu drops with it. The device is a Vulkan device and the one of
            // the session.
            unsafe {
                let device = self.gpu.device.as_hal::<hal::api::Vulkan>()?;
                let memory = hal::vulkan::TextureMemory::External;
                let image = vk::Image::from_raw(image);
                let raw = device.texture_from_raw(image, &own, Some(Box::new(move || drop(keeps))), memory);
                drop(device);
                Some(self.gpu.device.create_texture_from_hal::<hal::api::Vulkan>(raw, descriptor, state))
            }
        };
        let textures: Option<Vec<_>> = images.into_iter().map(texture).collect();
        textures.ok_or_else(|| DeviceError::Headset("its device is not a Vulkan device".to_owned()))
    }
}

/// Returns `vkGetInstanceProcAddr` as the type that OpenXR declares for it.
fn load_function(entry: &ash::Entry) -> LoadVulkan {
    let load = entry.static_fn().get_instance_proc_addr;
    // SAFETY: both types describe the same function; handles are pointers.
    unsafe { std::mem::transmute::<vk::PFN_vkGetInstanceProcAddr, LoadVulkan>(load) }
}
