//! Swapchains of the runtime, with one array layer for each eye or a single layer.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use openxr::{
    Duration, Extent2Di, Offset2Di, Rect2Di, Session, Swapchain, SwapchainCreateFlags, SwapchainCreateInfo,
    SwapchainSubImage, SwapchainUsageFlags, Vulkan,
};

use super::error::{HeadsetError, OpenXrResult};
use crate::device::{GpuDevice, HeadsetDevice};
use crate::image::Extent;

/// Format of swapchain images: the value of its `VkFormat`, and the same format in wgpu.
pub type Format = (u32, wgpu::TextureFormat);

/// Colour formats, in order of preference.
pub const COLOURS: [Format; 2] = [(43, wgpu::TextureFormat::Rgba8UnormSrgb), (50, wgpu::TextureFormat::Bgra8UnormSrgb)];
/// Depth formats, in order of preference.
pub const DEPTHS: [Format; 2] = [(126, wgpu::TextureFormat::Depth32Float), (124, wgpu::TextureFormat::Depth16Unorm)];

/// Returns the first of these formats that the session offers, or `None` if it offers none of them.
///
/// # Errors
/// Errors of the runtime.
pub fn offered(session: &Session<Vulkan>, formats: &[Format]) -> Result<Option<Format>, HeadsetError> {
    let offered = session.enumerate_swapchain_formats().to("list its swapchain formats")?;
    Ok(formats.iter().copied().find(|(number, _)| offered.contains(number)))
}

pub struct Chain {
    textures: Vec<wgpu::Texture>,
    swapchain: Arc<Mutex<Swapchain<Vulkan>>>,
    pub extent: Extent,
    pub format: wgpu::TextureFormat,
}

impl Chain {
    /// Creates a swapchain whose images have this number of layers.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn new(
        device: &HeadsetDevice,
        session: &Session<Vulkan>,
        (number, format): Format,
        extent: Extent,
        layers: u32,
    ) -> Result<Self, HeadsetError> {
        let Extent { width, height } = extent;
        let kind = if format.is_depth_stencil_format() {
            SwapchainUsageFlags::DEPTH_STENCIL_ATTACHMENT
        } else {
            SwapchainUsageFlags::COLOR_ATTACHMENT | SwapchainUsageFlags::MUTABLE_FORMAT
        };
        let info = SwapchainCreateInfo {
            create_flags: SwapchainCreateFlags::EMPTY,
            usage_flags: kind | SwapchainUsageFlags::SAMPLED,
            format: number,
            sample_count: 1,
            width,
            height,
            face_count: 1,
            array_size: layers,
            mip_count: 1,
        };
        let swapchain = session.create_swapchain(&info).to("create a swapchain of this size")?;
        let descriptor = wgpu::TextureDescriptor {
            label: Some("headset"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[format.remove_srgb_suffix()],
        };
        let images = swapchain.enumerate_images().to("list the images of a swapchain")?;
        let swapchain = Arc::new(Mutex::new(swapchain));
        let textures = device.textures(&swapchain, images, &descriptor, at_rest(format))?;
        Ok(Self { textures, swapchain, extent, format })
    }

    /// Acquires the next image, fills it and releases it.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn fill(
        &mut self,
        gpu: &GpuDevice,
        fill: impl FnOnce(&wgpu::Texture, &mut wgpu::CommandEncoder),
    ) -> Result<(), HeadsetError> {
        let mut swapchain = self.swapchain.lock().unwrap_or_else(PoisonError::into_inner);
        let index = swapchain.acquire_image().to("acquire a swapchain image")?;
        swapchain.wait_image(Duration::INFINITE).to("wait for a swapchain image")?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        if let Some(texture) = self.textures.get(index as usize) {
            fill(texture, &mut encoder);
            // Return the image to the state in which the runtime expects it.
            let state = at_rest(self.format);
            let back = wgpu::TextureTransition { texture, selector: None, state };
            encoder.transition_resources(std::iter::empty(), std::iter::once(back));
        }
        gpu.queue.submit([encoder.finish()]);
        swapchain.release_image().to("release a swapchain image")
    }

    /// Locks the images for use in a frame's layers.
    pub fn lock(&self) -> Images<'_> {
        Images { swapchain: self.swapchain.lock().unwrap_or_else(PoisonError::into_inner), extent: self.extent }
    }
}

/// Images of a swapchain, locked while a frame with them is submitted.
pub struct Images<'a> {
    swapchain: MutexGuard<'a, Swapchain<Vulkan>>,
    extent: Extent,
}

impl Images<'_> {
    /// Returns one layer of the newest image.
    pub fn layer(&self, layer: u32) -> SwapchainSubImage<'_, Vulkan> {
        let Extent { width, height } = self.extent;
        let extent = Extent2Di { width: width as i32, height: height as i32 };
        let rect = Rect2Di { offset: Offset2Di { x: 0, y: 0 }, extent };
        SwapchainSubImage::new().swapchain(&self.swapchain).image_array_index(layer).image_rect(rect)
    }
}

/// Returns the state that `XR_KHR_vulkan_enable2` prescribes for images when they are acquired from the runtime and
/// released to it: colour attachment or depth attachment.
fn at_rest(format: wgpu::TextureFormat) -> wgpu::TextureUses {
    if format.is_depth_stencil_format() {
        wgpu::TextureUses::DEPTH_STENCIL_WRITE
    } else {
        wgpu::TextureUses::COLOR_TARGET
    }
}
