//! Opens a device that presents the images of other devices in a window.

use std::sync::PoisonError;

use super::adapters::{DeviceInfo, OPENING, new_instance};
use super::opening::watched;
use super::{DeviceError, GpuDevice, Quirks, environment};

/// Device that presents images in a window. To take little performance from the rendering devices, it prefers an
/// integrated GPU, and on a software adapter it has one worker thread.
#[derive(Debug)]
pub struct ScreenDevice {
    pub gpu: GpuDevice,
    pub adapter: wgpu::Adapter,
    pub surface: wgpu::Surface<'static>,
    instance: wgpu::Instance,
}

impl ScreenDevice {
    /// Opens a device that can present to `window`.
    ///
    /// # Errors
    /// [`DeviceError::Surface`] if the window cannot have a surface, [`DeviceError::NoScreen`] if no adapter can draw
    /// into it, [`DeviceError::Open`] if the device cannot be opened.
    pub fn open(window: impl Into<wgpu::SurfaceTarget<'static>>) -> Result<Self, DeviceError> {
        let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        environment::set_threads(1);
        let instance = new_instance();
        let surface = instance.create_surface(window)?;
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::LowPower,
            compatible_surface: Some(&surface),
            ..Default::default()
        }))?;
        let described = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("diptych window"),
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|source| DeviceError::Open { index: 0, name: described.name.clone(), source })?;
        Ok(Self { gpu: watched_screen(described, device, queue), adapter, surface, instance })
    }

    /// Recreates the surface after it was lost.
    ///
    /// # Errors
    /// [`DeviceError::Surface`].
    pub fn renew_surface(&mut self, window: impl Into<wgpu::SurfaceTarget<'static>>) -> Result<(), DeviceError> {
        self.surface = self.instance.create_surface(window)?;
        Ok(())
    }
}

/// Wraps a device that presents images of others; `described` is its adapter.
pub(super) fn watched_screen(described: wgpu::AdapterInfo, device: wgpu::Device, queue: wgpu::Queue) -> GpuDevice {
    let quirks = Quirks::of(&described);
    let threads = (quirks.threads_by_environment && environment::is_settable()).then_some(1);
    let info = DeviceInfo { threads, ..DeviceInfo::new(&described, &device) };
    watched(info, quirks, device, queue)
}
