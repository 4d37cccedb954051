//! Arrays of a frame, on the host or on the device.

use crate::device::GpuDevice;
use crate::image::Extent;

/// Bytes of a pixel in a buffer: four `f32`.
const PIXEL: usize = size_of::<[f32; 4]>();

/// An array of pixels, row after row from the top left: `&[[f32; 3]]` on the host, or a [`wgpu::Buffer`] of the denoiser's
/// device. A buffer has the usage `COPY_SRC` and four `f32` per pixel, of which the last one is padding, like an
/// `array<vec3<f32>>` or an `array<vec4<f32>>` in WGSL.
pub trait Array: Copy {
    /// Checks whether the array has all pixels of the image. If `is_finite` is set, also checks the values of an array on
    /// the host.
    ///
    /// # Errors
    /// Says why the array cannot be used, as a phrase that follows its name.
    fn check(self, extent: Extent, is_finite: bool) -> Result<(), String>;

    /// Returns a buffer of the device with these pixels.
    fn buffer(self, gpu: &GpuDevice) -> wgpu::Buffer;
}

impl Array for &[[f32; 3]] {
    fn check(self, extent: Extent, is_finite: bool) -> Result<(), String> {
        if self.len() != extent.area() {
            return Err(format!("has {} pixels, which are not {extent}", self.len()));
        }
        match self.as_flattened().iter().filter(|value| !value.is_finite()).count() {
            wrong if is_finite && wrong > 0 => Err(format!("has {wrong} values that are not finite")),
            _ => Ok(()),
        }
    }

    fn buffer(self, gpu: &GpuDevice) -> wgpu::Buffer {
        gpu.staged(self.iter().map(|&[x, y, z]| bytemuck::cast([x, y, z, 0.0])))
    }
}

impl Array for &wgpu::Buffer {
    fn check(self, extent: Extent, _: bool) -> Result<(), String> {
        let least = (extent.area() * PIXEL) as u64;
        if self.size() < least {
            return Err(format!("has {} bytes, but {extent} pixels need {least}", self.size()));
        }
        match self.usage().contains(wgpu::BufferUsages::COPY_SRC) {
            true => Ok(()),
            false => Err("is a buffer without the usage COPY_SRC".to_owned()),
        }
    }

    fn buffer(self, _: &GpuDevice) -> wgpu::Buffer {
        self.clone()
    }
}
