//! Draws pixel buffers of both eyes into the runtime's swapchains.

use openxr::{Session, Vulkan, sys};

use super::chain::{Chain, Format, Images, offered};
use super::error::HeadsetError;
use crate::device::{GpuDevice, HeadsetDevice};
use crate::exec::PerView;
use crate::image::Extent;
use crate::scene::optics::{Fov, HeadEyes};
use crate::scene::rig::Eye;

/// Near plane of depth images, metres along the eye's axis. Depth is reversed: 1 at this plane and nearer, 0 at
/// infinity.
const NEAR_M: f64 = 0.01;

/// Pixels of an image in row-major order from the top.
#[derive(Debug)]
pub enum Pixels {
    /// Buffer on the device from which the runtime takes images.
    Buffer(wgpu::Buffer),
    Bytes(Vec<u8>),
}

/// Uniforms of the shaders: tangents of the image's left, right, upper and lower edges, its columns and rows, and the
/// near plane in scene units.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Constants {
    edges: [f32; 4],
    extent: [u32; 2],
    near: f32,
    unused: f32,
}

impl Constants {
    fn new(extent: Extent, fov: &Fov, metres_per_unit: f64) -> Self {
        let Fov { left, right, up, down } = *fov;
        let edges = [left, right, up, down].map(|angle| angle.tan() as f32);
        let near = (NEAR_M / metres_per_unit) as f32;
        Self { edges, extent: [extent.width, extent.height], near, unused: 0.0 }
    }
}

/// Pipeline that draws the pixels of a buffer, colours or depths, over a whole attachment of this format.
struct Painter {
    pipeline: wgpu::RenderPipeline,
    format: wgpu::TextureFormat,
}

/// Swapchain of colour or depth images with a layer for each eye, and the pipeline that fills it.
pub struct Drawing {
    chain: Chain,
    painter: Painter,
}

impl Drawing {
    /// Creates a swapchain with one of these formats; returns `None` if the session offers none of them. `formats` also
    /// determines the pixels that [`Self::fill`] expects. With [`COLOURS`], a pixel is four bytes, already encoded for
    /// the screen. With [`DEPTHS`], a pixel is four floats, of which the first is the distance along the pixel's ray in
    /// scene units, 0 for the sky. The swapchain then holds depths as defined by `XR_KHR_composition_layer_depth`.
    ///
    /// [`COLOURS`]: super::chain::COLOURS
    /// [`DEPTHS`]: super::chain::DEPTHS
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn new(
        device: &HeadsetDevice,
        session: &Session<Vulkan>,
        formats: &[Format],
        extent: Extent,
    ) -> Result<Option<Self>, HeadsetError> {
        let Some(format) = offered(session, formats)? else { return Ok(None) };
        let chain = Chain::new(device, session, format, extent, 2)?;
        let painter = Painter::new(&device.gpu.device, chain.format);
        Ok(Some(Self { chain, painter }))
    }

    /// Fills the next image from the eyes' pixels. A scene unit is `metres_per_unit` long.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn fill(
        &mut self,
        gpu: &GpuDevice,
        pixels: &PerView<Pixels>,
        eyes: &HeadEyes,
        metres_per_unit: f64,
    ) -> Result<(), HeadsetError> {
        let Self { chain, painter } = self;
        let extent = chain.extent;
        chain.fill(gpu, |texture, encoder| {
            let eyes = [(pixels.left(), &eyes.left), (pixels.right(), &eyes.right)];
            for (layer, (pixels, eye)) in (0..).zip(eyes) {
                let constants = Constants::new(extent, &eye.fov, metres_per_unit);
                painter.paint(gpu, encoder, &constants, pixels, &painter.view(texture, layer));
            }
        })
    }

    pub fn lock(&self) -> Images<'_> {
        self.chain.lock()
    }
}

impl Painter {
    /// Creates the pipeline for attachments of this format. Colours are already sRGB-encoded, so they are written
    /// through a texture view of the corresponding format without sRGB conversion.
    fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let format = format.remove_srgb_suffix();
        let is_depth = format.is_depth_stencil_format();
        let targets = [Some(format.into())];
        let module = device.create_shader_module(wgpu::include_wgsl!("../../shaders/present/pixels.wgsl"));
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("headset"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: is_depth.then(|| wgpu::DepthStencilState {
                format,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Always),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(if is_depth { "depth" } else { "colour" }),
                compilation_options: Default::default(),
                targets: &targets[usize::from(is_depth)..],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { pipeline, format }
    }

    fn view(&self, texture: &wgpu::Texture, layer: u32) -> wgpu::TextureView {
        texture.create_view(&wgpu::TextureViewDescriptor {
            format: Some(self.format),
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        })
    }

    fn paint(
        &self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        constants: &Constants,
        pixels: &Pixels,
        view: &wgpu::TextureView,
    ) {
        let filled = |usage, bytes: &[u8]| {
            let buffer = gpu.buffer("headset", bytes.len() as u64, usage | wgpu::BufferUsages::COPY_DST);
            gpu.queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let constants = filled(wgpu::BufferUsages::UNIFORM, bytemuck::bytes_of(constants));
        let pixels = match pixels {
            Pixels::Buffer(buffer) => buffer,
            Pixels::Bytes(bytes) => &filled(wgpu::BufferUsages::STORAGE, bytes),
        };
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("headset"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: constants.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: pixels.as_entire_binding() },
            ],
        });
        let is_depth = self.format.is_depth_stencil_format();
        // The clear values do not matter, since the draw covers every pixel.
        let colours = [Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
        })];
        let depth = wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("headset"),
            color_attachments: &colours[usize::from(is_depth)..],
            depth_stencil_attachment: is_depth.then_some(depth),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.draw(0..3, 0..1);
    }
}

/// Describes an eye's depth image to the runtime (`XR_KHR_composition_layer_depth`). Depth is reversed, with 0 at
/// infinity.
pub fn depth_info(images: &Images<'_>, eye: Eye) -> sys::CompositionLayerDepthInfoKHR {
    sys::CompositionLayerDepthInfoKHR {
        ty: sys::CompositionLayerDepthInfoKHR::TYPE,
        next: std::ptr::null(),
        sub_image: images.layer(eye.index() as u32).into_raw(),
        min_depth: 0.0,
        max_depth: 1.0,
        near_z: f32::INFINITY,
        far_z: NEAR_M as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Selection, open};
    use wgpu::TextureFormat;

    const EXTENT: Extent = Extent { width: 64, height: 5 };
    /// Field of view that is larger downwards than upwards and to the left than to the right.
    const FOV: Fov = Fov { left: -0.9, right: 0.6, up: 0.5, down: -0.8 };

    /// Draws these pixels into a texture of this format and returns the bytes of the texture. A scene unit is half a
    /// metre.
    fn drawn(pixels: impl Fn(&GpuDevice) -> Pixels, format: TextureFormat) -> Vec<u8> {
        let gpu = open(&Selection::default()).unwrap().remove(0);
        let size = wgpu::Extent3d { width: EXTENT.width, height: EXTENT.height, depth_or_array_layers: 1 };
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[format.remove_srgb_suffix()],
        });
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let back = gpu.buffer("read back", u64::from(4 * EXTENT.width * EXTENT.height), usage);
        let painter = Painter::new(&gpu.device, format);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let constants = Constants::new(EXTENT, &FOV, 0.5);
        painter.paint(&gpu, &mut encoder, &constants, &pixels(&gpu), &painter.view(&texture, 0));
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * EXTENT.width), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &back, layout },
            size,
        );
        gpu.queue.submit([encoder.finish()]);
        back.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait(None).unwrap();
        assert!(gpu.failure().is_none(), "{:?}", gpu.failure());
        back.get_mapped_range(..).unwrap().to_vec()
    }

    fn depths(distance: impl Fn(u32, u32) -> f32) -> Vec<f32> {
        let places = (0..EXTENT.height).flat_map(|y| (0..EXTENT.width).map(move |x| (x, y)));
        let texels: Vec<[f32; 4]> = places.map(|(x, y)| [distance(x, y), f32::NAN, 7.0, -1.0]).collect();
        let pixels = |_: &GpuDevice| Pixels::Bytes(bytemuck::cast_slice(&texels).to_vec());
        bytemuck::pod_collect_to_vec(&drawn(pixels, TextureFormat::Depth32Float))
    }

    /// Draws a wall 2 m ahead of the eye.
    #[test]
    fn flat_wall_has_constant_depth() {
        let [left, right, up, down] = [FOV.left, FOV.right, FOV.up, FOV.down].map(f64::tan);
        let ray = |x: u32, y: u32| {
            let (x, y) =
                ((f64::from(x) + 0.5) / f64::from(EXTENT.width), (f64::from(y) + 0.5) / f64::from(EXTENT.height));
            let (across, upward) = (left + (right - left) * x, up + (down - up) * y);
            (4.0 * (1.0 + across.powi(2) + upward.powi(2)).sqrt()) as f32
        };
        assert!(ray(0, 0) > 1.2 * ray(40, 2));
        for value in depths(ray) {
            assert!((f64::from(value) - NEAR_M / 2.0).abs() < 2e-8, "{value}");
        }
    }

    #[test]
    fn depth_is_zero_for_sky_and_clamped_at_near_plane() {
        let distances = [0.0, 1e-4, 1e30, f32::INFINITY, f32::NAN];
        let values = depths(|x, _| distances[x.min(4) as usize]);
        assert_eq!([values[0], values[1], values[3], values[4]], [0.0, 1.0, 0.0, 0.0]);
        assert!(values[2] > 0.0 && values[2] < 1e-30);
    }

    /// Pixels come from the host and from a device buffer, in every channel order.
    #[test]
    fn drawn_pixels_keep_their_bytes() {
        let bytes: Vec<u8> = (0..4 * EXTENT.width * EXTENT.height).map(|i| (i * 7 % 256) as u8).collect();
        let from_host = |_: &GpuDevice| Pixels::Bytes(bytes.clone());
        let from_device = |gpu: &GpuDevice| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            let buffer = gpu.buffer("pixels", bytes.len() as u64, usage);
            gpu.queue.write_buffer(&buffer, 0, &bytes);
            Pixels::Buffer(buffer)
        };
        assert_eq!(drawn(from_host, TextureFormat::Rgba8UnormSrgb), bytes);
        assert_eq!(drawn(from_device, TextureFormat::Rgba8UnormSrgb), bytes);
        let swapped: Vec<u8> = bytes.chunks(4).flat_map(|p| [p[2], p[1], p[0], p[3]]).collect();
        assert_eq!(drawn(from_device, TextureFormat::Bgra8UnormSrgb), swapped);
    }
}
