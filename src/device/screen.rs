//! A device that shows in a window what others have rendered.

use std::sync::PoisonError;

use super::adapters::new_instance;
use super::opening::{OPENING, watched_screen};
use super::{DeviceError, GpuDevice};

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
        let described = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("diptych window"),
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|source| DeviceError::Open { index: 0, name: described.name.clone(), source })?;
        Ok(Self { gpu: watched_screen(described, device, queue, instance), adapter, surface })
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
