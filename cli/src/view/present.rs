//! Draws the eyes' images and the overlay into the window, or into an image of the same size.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow};
use diptych::device::ScreenDevice;
use diptych::image::display::DisplayImage;
use diptych::image::{Extent, Image};
use egui::TexturesDelta;
use winit::window::Window;

use super::layout::{Placement, Shows};
use super::overlay::Painted;
use super::painter::Painter;
use super::shared::EyeImages;

/// Clear colour around the images.
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.055, g: 0.055, b: 0.06, a: 1.0 };

/// Contents of the window.
#[derive(Default)]
pub struct Drawing {
    pub placements: Vec<Placement>,
    /// True if magnified pixels stay sharp squares.
    pub is_sharp: bool,
    pub overlay: Painted,
}

pub struct Presenter {
    window: Arc<Window>,
    screen: ScreenDevice,
    config: wgpu::SurfaceConfiguration,
    /// Two pipelines, for one eye and for an anaglyph. A branch in one shader would cost time on software adapters,
    /// even if not taken.
    pipelines: [wgpu::RenderPipeline; 2],
    /// Texture array with a layer per eye.
    eyes: wgpu::Texture,
    /// Bind groups of each pipeline for smooth and for sharp pixels.
    bindings: [[wgpu::BindGroup; 2]; 2],
    painter: Painter,
}

impl Presenter {
    pub fn new(window: Arc<Window>, eye: Extent) -> Result<Self, anyhow::Error> {
        let screen = ScreenDevice::open(Arc::clone(&window))?;
        let device = &screen.gpu.device;
        let mut config =
            screen.surface.get_default_config(&screen.adapter, 1, 1).context("cannot present to the window")?;
        // Images and overlay are already sRGB encoded: prefer a format that does not encode again.
        let formats = screen.surface.get_capabilities(&screen.adapter).formats;
        config.format = formats.into_iter().find(|f| !f.is_srgb()).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        config.desired_maximum_frame_latency = 1;
        let size = wgpu::Extent3d { width: eye.width, height: eye.height, depth_or_array_layers: 2 };
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let eyes = texture(device, "eyes", size, wgpu::TextureFormat::Rgba8Unorm, usage);
        let pipelines = ["show", "show_both"].map(|entry| pipeline(device, config.format, entry));
        let filters = [wgpu::FilterMode::Linear, wgpu::FilterMode::Nearest];
        let bindings = pipelines.each_ref().map(|pipeline| filters.map(|filter| bind(device, pipeline, &eyes, filter)));
        let painter = Painter::new(&screen.gpu, config.format);
        let mut presenter = Self { window, screen, config, pipelines, eyes, bindings, painter };
        presenter.resize();
        Ok(presenter)
    }

    /// Returns the minimum time between redraws: on a software adapter, drawing takes time from the devices that
    /// render.
    pub fn least_interval(&self) -> Duration {
        if self.screen.gpu.info.threads.is_some() { Duration::from_millis(33) } else { Duration::ZERO }
    }

    /// Returns the size of the window in pixels, at least 1×1.
    pub fn size(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    /// Adopts the window's current size.
    pub fn resize(&mut self) {
        let size = self.window.inner_size();
        let most = self.screen.gpu.device.limits().max_texture_dimension_2d;
        (self.config.width, self.config.height) = (size.width.clamp(1, most), size.height.clamp(1, most));
        self.screen.surface.configure(&self.screen.gpu.device, &self.config);
    }

    /// Uploads the eyes' images for the following drawings.
    pub fn upload(&self, images: &EyeImages) {
        for (layer, image) in images.outer().into_iter().enumerate() {
            let Extent { width, height } = image.extent;
            let origin = wgpu::Origin3d { x: 0, y: 0, z: layer as u32 };
            self.screen.gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo { origin, ..self.eyes.as_image_copy() },
                image.pixels.as_flattened(),
                wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None },
                wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            );
        }
    }

    /// Applies changes of the overlay's textures. The next call frees those that the overlay no longer needs.
    pub fn take_textures(&mut self, textures: TexturesDelta) {
        self.painter.take_textures(&self.screen.gpu, textures);
    }

    /// Shows the drawing in the window, unless the window is hidden. Returns false if the caller should try again.
    pub fn present(&mut self, drawing: &Drawing) -> Result<bool, anyhow::Error> {
        use wgpu::CurrentSurfaceTexture::{Lost, Occluded, Outdated, Suboptimal, Success, Timeout, Validation};
        let target = match self.screen.surface.get_current_texture() {
            Success(target) | Suboptimal(target) => target,
            Occluded => return Ok(true),
            Timeout | Validation => return self.check().map(|()| false),
            Outdated => {
                self.resize();
                return Ok(false);
            }
            Lost => {
                self.screen.renew_surface(Arc::clone(&self.window))?;
                self.resize();
                return Ok(false);
            }
        };
        self.draw(drawing, &target.texture);
        self.window.pre_present_notify();
        self.screen.gpu.queue.present(target);
        self.check().map(|()| true)
    }

    fn check(&self) -> Result<(), anyhow::Error> {
        self.screen.gpu.failure().map_or(Ok(()), |failure| Err(anyhow!("the window's device failed: {}", failure.what)))
    }

    /// Renders the drawing to an image of the window's size.
    pub fn capture(&mut self, drawing: &Drawing) -> Result<DisplayImage, anyhow::Error> {
        let [width, height] = self.size();
        let device = &self.screen.gpu.device;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = texture(device, "screenshot", size, self.config.format, usage);
        let row_bytes = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("screenshot"),
            size: u64::from(row_bytes) * u64::from(height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.draw(drawing, &texture);
        let mut encoder = self.screen.gpu.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            size,
        );
        self.screen.gpu.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        self.screen.gpu.wait(None).map_err(|failure| anyhow!("the window's device failed: {}", failure.what))?;
        let bytes = buffer.get_mapped_range(..).context("cannot read the screenshot")?;
        let blue_first = matches!(self.config.format.remove_srgb_suffix(), wgpu::TextureFormat::Bgra8Unorm);
        let pixel = |p: &[u8; 4]| if blue_first { [p[2], p[1], p[0]] } else { [p[0], p[1], p[2]] };
        let rows = bytes.chunks_exact(row_bytes as usize).map(|row| &row[..4 * width as usize]);
        let pixels = rows.flat_map(|row| row.as_chunks().0.iter().map(pixel)).collect();
        Ok(Image { extent: Extent::new(width, height), pixels })
    }

    fn draw(&mut self, drawing: &Drawing, target: &wgpu::Texture) {
        let size = self.size();
        let Self { screen, pipelines, bindings, painter, .. } = self;
        let mut encoder = screen.gpu.device.create_command_encoder(&Default::default());
        painter.draw(&screen.gpu, &mut encoder, (target, size), BACKGROUND, &drawing.overlay, |pass| {
            for placement in &drawing.placements {
                let [x, y, width, height] =
                    [placement.x, placement.y, placement.width(), placement.height()].map(|n| n as f32);
                if width >= 1.0 && height >= 1.0 {
                    let pipeline = usize::from(placement.shows == Shows::Anaglyph);
                    pass.set_viewport(x, y, width, height, 0.0, 1.0);
                    pass.set_pipeline(&pipelines[pipeline]);
                    pass.set_bind_group(0, &bindings[pipeline][usize::from(drawing.is_sharp)], &[]);
                    let shows = placement.shows as u32;
                    pass.draw(0..3, shows..shows + 1);
                }
            }
        });
        screen.gpu.queue.submit([encoder.finish()]);
    }
}

fn texture(
    device: &wgpu::Device,
    label: &str,
    size: wgpu::Extent3d,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

fn bind(
    device: &wgpu::Device,
    pipeline: &wgpu::RenderPipeline,
    eyes: &wgpu::Texture,
    filter: wgpu::FilterMode,
) -> wgpu::BindGroup {
    let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: filter,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    });
    let view = eyes.create_view(&Default::default());
    let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("eyes"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            entry(0, wgpu::BindingResource::TextureView(&view)),
            entry(1, wgpu::BindingResource::Sampler(&sampler)),
        ],
    })
}

fn pipeline(device: &wgpu::Device, format: wgpu::TextureFormat, entry: &str) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("picture"),
        source: wgpu::ShaderSource::Wgsl(include_str!("../../shaders/picture.wgsl").into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("picture"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("cover"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: None,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[("DECODES", f64::from(u8::from(format.is_srgb())))],
                ..Default::default()
            },
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
