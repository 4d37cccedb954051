//! A device that shows in a window what others have rendered.

use std::sync::PoisonError;

use super::adapters::{OPENING, kind_name, new_instance, watched};
use super::{DeviceError, DeviceInfo, GpuDevice, Quirks, Traversal};

/// Takes as little as it can from the devices that render: an integrated GPU is preferred, and on a software adapter it
/// has one worker thread.
#[derive(Debug)]
pub struct ScreenDevice {
    pub gpu: GpuDevice,
    pub adapter: wgpu::Adapter,
    pub surface: wgpu::Surface<'static>,
}

impl ScreenDevice {
    /// # Errors
    /// [`DeviceError::Surface`], [`DeviceError::NoScreen`] and [`DeviceError::Open`].
    pub fn open(window: impl Into<wgpu::SurfaceTarget<'static>>) -> Result<Self, DeviceError> {
        let _guard = OPENING.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: as for devices that render; they are opened before the window is.
        unsafe { std::env::set_var("LP_NUM_THREADS", "1") };
        let instance = new_instance();
        let surface = instance.create_surface(window)?;
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::LowPower,
            compatible_surface: Some(&surface),
            ..Default::default()
        }))?;
        let (described, limits) = (adapter.get_info(), adapter.limits());
        let quirks = Quirks::of(&described);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("diptych window"),
            required_limits: limits.clone(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|source| DeviceError::Open { index: 0, name: described.name.clone(), source })?;
        let info = DeviceInfo {
            index: 0,
            adapter: 0,
            name: described.name,
            driver: format!("{} {}", described.driver, described.driver_info).trim().to_owned(),
            kind: kind_name(described.device_type).to_owned(),
            threads: quirks.threads_by_environment.then_some(1),
            traversal: Traversal::Compute,
            max_storage_bytes: limits.max_storage_buffer_binding_size,
            clock_residual_us: 0.0,
            rank: None,
        };
        Ok(Self { gpu: watched(info, quirks, device, queue, instance), adapter, surface })
    }

    /// Makes the surface anew after it was lost.
    ///
    /// # Errors
    /// [`DeviceError::Surface`].
    pub fn renew_surface(&mut self, window: impl Into<wgpu::SurfaceTarget<'static>>) -> Result<(), DeviceError> {
        self.surface = self.gpu.instance.create_surface(window)?;
        Ok(())
    }
}
