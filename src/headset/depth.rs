//! Distances of what is seen, as `XR_KHR_composition_layer_depth` has them: reversed, so that the far ones keep their digits.

use openxr::sys;

use super::chain::{Chain, DEPTHS, Images, offered};
use super::error::HeadsetError;
use crate::device::{GpuDevice, HeadsetDevice};
use crate::exec::Stereo;
use crate::image::Extent;
use crate::scene::optics::{Fov, HeadEyes};
use crate::scene::rig::Eye;

/// What is nearer is as near, metres along the eye's axis; it is encoded as 1, and what is infinitely far as 0.
const NEAR_M: f64 = 0.01;

/// Distances along the rays of an eye's pixels, in units of so many metres, above 0 or sky, as the layer has them.
pub fn encoded(distances: &[f32], extent: Extent, fov: &Fov, metres_per_unit: f64) -> Vec<f32> {
    let Fov { left, right, up, down } = *fov;
    let [left, right, up, down] = [left, right, up, down].map(f64::tan);
    let (width, height) = (f64::from(extent.width), f64::from(extent.height));
    let place = |i: usize| [i % extent.width as usize, i / extent.width as usize].map(|p| p as f64 + 0.5);
    let encoded = |(i, distance): (usize, &f32)| {
        let [x, y] = place(i);
        let (across, upward) = (left + (right - left) * x / width, up + (down - up) * y / height);
        let along_m = f64::from(*distance) * metres_per_unit / (1.0 + across * across + upward * upward).sqrt();
        if along_m > 0.0 { (NEAR_M / along_m).min(1.0) as f32 } else { 0.0 }
    };
    distances.iter().enumerate().map(encoded).collect()
}

/// Images of distances beside those of colours.
pub struct Depth {
    chain: Chain,
    pipeline: wgpu::RenderPipeline,
    /// A layer for each eye.
    source: wgpu::Texture,
    bindings: [wgpu::BindGroup; 2],
    extent: Extent,
}

impl Depth {
    /// None where the session takes no such images.
    ///
    /// # Errors
    /// What the runtime says.
    pub fn new(
        device: &HeadsetDevice,
        session: &openxr::Session<openxr::Vulkan>,
        extent: Extent,
    ) -> Result<Option<Self>, HeadsetError> {
        let Some(format) = offered(session, &DEPTHS)? else { return Ok(None) };
        let chain = Chain::new(device, session, format, extent, 2)?;
        let gpu = &device.gpu.device;
        let source = gpu.create_texture(&wgpu::TextureDescriptor {
            label: Some("distances"),
            size: wgpu::Extent3d { width: extent.width, height: extent.height, depth_or_array_layers: 2 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let pipeline = pipeline(gpu, chain.format);
        let layout = pipeline.get_bind_group_layout(0);
        let bindings = [0, 1].map(|layer| {
            let view = source.create_view(&one_layer(layer));
            let resource = wgpu::BindingResource::TextureView(&view);
            let entries = &[wgpu::BindGroupEntry { binding: 0, resource }];
            gpu.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("distances"), layout: &layout, entries })
        });
        Ok(Some(Self { chain, pipeline, source, bindings, extent }))
    }

    /// Fills the next image with the distances that eyes see, [`encoded`].
    ///
    /// # Errors
    /// What the runtime says.
    pub fn fill(&mut self, gpu: &GpuDevice, encoded: &Stereo<Vec<f32>>) -> Result<(), HeadsetError> {
        let Self { chain, pipeline, source, bindings, extent } = self;
        chain.fill(gpu, |texture, encoder| {
            for (layer, values) in (0..).zip([&encoded.left, &encoded.right]) {
                write_layer(gpu, source, layer, *extent, bytemuck::cast_slice(values));
                let view = texture.create_view(&one_layer(layer));
                let depth = wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store };
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("distances"),
                    depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                        view: &view,
                        depth_ops: Some(depth),
                        stencil_ops: None,
                    }),
                    ..Default::default()
                });
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bindings[layer as usize], &[]);
                pass.draw(0..3, 0..1);
            }
        })
    }

    pub fn lock(&self) -> Images<'_> {
        self.chain.lock()
    }
}

/// What a layer's view has beside its colours.
pub fn info(images: &Images<'_>, eye: Eye) -> sys::CompositionLayerDepthInfoKHR {
    sys::CompositionLayerDepthInfoKHR {
        ty: sys::CompositionLayerDepthInfoKHR::TYPE,
        next: std::ptr::null(),
        sub_image: images.layer(eye as u32).into_raw(),
        min_depth: 0.0,
        max_depth: 1.0,
        near_z: f32::INFINITY,
        far_z: NEAR_M as f32,
    }
}

/// Both eyes' distances along their rays, [`encoded`].
pub fn encoded_eyes(
    distances: &Stereo<Vec<f32>>,
    extent: Extent,
    eyes: &HeadEyes,
    metres_per_unit: f64,
) -> Stereo<Vec<f32>> {
    Stereo {
        left: encoded(&distances.left, extent, &eyes.left.fov, metres_per_unit),
        right: encoded(&distances.right, extent, &eyes.right.fov, metres_per_unit),
    }
}

/// Copies an image of four bytes for each pixel into a layer.
pub fn write_layer(gpu: &GpuDevice, texture: &wgpu::Texture, layer: u32, extent: Extent, bytes: &[u8]) {
    let Extent { width, height } = extent;
    let origin = wgpu::Origin3d { x: 0, y: 0, z: layer };
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo { origin, ..texture.as_image_copy() },
        bytes,
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

fn one_layer(layer: u32) -> wgpu::TextureViewDescriptor<'static> {
    wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    }
}

/// Writes each pixel's value as its depth, which no copy may do for all formats.
fn pipeline(device: &wgpu::Device, format: wgpu::TextureFormat) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::include_wgsl!("depth.wgsl"));
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("distances"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("cover"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("depth"),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall 2 m ahead of the eye, which sees further down than up and further to the left than to the right.
    #[test]
    fn a_wall_is_as_far_everywhere() {
        let fov = Fov { left: -0.9, right: 0.6, up: 0.5, down: -0.8 };
        let (extent, metres_per_unit) = (Extent::new(7, 5), 0.5);
        let [left, right, up, down] = [fov.left, fov.right, fov.up, fov.down].map(f64::tan);
        let ray = |i: usize| {
            let (x, y) = ((i % 7) as f64 + 0.5, (i / 7) as f64 + 0.5);
            let (across, upward) = (left + (right - left) * x / 7.0, up + (down - up) * y / 5.0);
            (4.0 * (1.0 + across.powi(2) + upward.powi(2)).sqrt()) as f32
        };
        let distances: Vec<f32> = (0..35).map(ray).collect();
        assert!(distances[0] > 1.2 * distances[17]);
        for value in encoded(&distances, extent, &fov, metres_per_unit) {
            assert!((f64::from(value) - NEAR_M / 2.0).abs() < 1e-8, "{value}");
        }
    }

    #[test]
    fn the_sky_is_infinitely_far_and_nothing_is_nearer_than_the_near_plane() {
        let fov = Fov { left: -0.1, right: 0.1, up: 0.1, down: -0.1 };
        let values = encoded(&[0.0, 1e-4, 1e30, f32::INFINITY, f32::NAN], Extent::new(5, 1), &fov, 1.0);
        assert_eq!([values[0], values[1], values[3], values[4]], [0.0, 1.0, 0.0, 0.0]);
        assert!(values[2] > 0.0 && values[2] < 1e-30);
    }
}
