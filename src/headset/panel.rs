//! A quad in space that the runtime composites over the frames, for example to show frame times.

use openxr::{CompositionLayerFlags, CompositionLayerQuad, Extent2Df, EyeVisibility, Session, Space, Vulkan};

use super::chain::{COLOURS, Chain, Images, offered};
use super::error::HeadsetError;
use super::pose::posef;
use crate::device::{GpuDevice, HeadsetDevice};
use crate::image::Extent;
use crate::scene::head::HeadPose;
use glam::DVec3;

/// Distance ahead of the head, and offset below the viewing direction, metres.
const AHEAD_M: f64 = 1.0;
const BELOW_M: f64 = 0.15;

/// Quad layer that shows the image last drawn into its swapchain. Pixels have premultiplied alpha.
pub struct Panel {
    chain: Chain,
    size_m: [f64; 2],
    /// Pose of the panel's centre, in the session's LOCAL reference space.
    pose: HeadPose,
}

impl Panel {
    /// Creates a panel of `extent` pixels that is `width_m` metres wide, ahead of the head pose `head`. Returns `None`
    /// if the session offers no format for it.
    pub(super) fn new(
        device: &HeadsetDevice,
        session: &Session<Vulkan>,
        extent: Extent,
        width_m: f64,
        head: HeadPose,
    ) -> Result<Option<Self>, HeadsetError> {
        let Some(format) = offered(session, &COLOURS)? else { return Ok(None) };
        let chain = Chain::new(device, session, format, extent, 1)?;
        let size_m = [width_m, width_m * f64::from(extent.height) / f64::from(extent.width)];
        let own = HeadPose { position_m: DVec3::new(0.0, -BELOW_M, -AHEAD_M), ..Default::default() };
        Ok(Some(Self { chain, size_m, pose: head.then(own) }))
    }

    pub fn format(&self) -> wgpu::TextureFormat {
        self.chain.format
    }

    /// Redraws the panel.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn fill(
        &mut self,
        gpu: &GpuDevice,
        fill: impl FnOnce(&wgpu::Texture, &mut wgpu::CommandEncoder),
    ) -> Result<(), HeadsetError> {
        self.chain.fill(gpu, fill)
    }

    pub(super) fn lock(&self) -> Images<'_> {
        self.chain.lock()
    }

    pub(super) fn layer<'a>(&self, images: &'a Images<'_>, space: &'a Space) -> CompositionLayerQuad<'a, Vulkan> {
        let [width, height] = self.size_m.map(|m| m as f32);
        CompositionLayerQuad::new()
            .layer_flags(CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA)
            .space(space)
            .eye_visibility(EyeVisibility::BOTH)
            .sub_image(images.layer(0))
            .pose(posef(self.pose))
            .size(Extent2Df { width, height })
    }
}
