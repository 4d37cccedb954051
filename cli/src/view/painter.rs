//! Draws the overlay into textures, over pictures or alone.

use egui::TexturesDelta;
use egui_wgpu::{RendererOptions, ScreenDescriptor};

use super::overlay::Painted;
use diptych::device::GpuDevice;

/// Draws overlays into textures of one format.
pub struct Painter {
    renderer: egui_wgpu::Renderer,
    /// Textures of the overlay to free with the next changes.
    freed: Vec<egui::TextureId>,
}

impl Painter {
    pub fn new(gpu: &GpuDevice, format: wgpu::TextureFormat) -> Self {
        let options = RendererOptions { dithering: false, ..Default::default() };
        Self { renderer: egui_wgpu::Renderer::new(&gpu.device, format, options), freed: Vec::new() }
    }

    /// Applies changes of the overlay's textures. The next call frees those that the overlay no longer needs.
    pub fn take_textures(&mut self, gpu: &GpuDevice, mut textures: TexturesDelta) {
        let Self { renderer, freed } = self;
        freed.drain(..).for_each(|id| renderer.free_texture(&id));
        for (id, deltas) in &textures.set {
            deltas.iter().for_each(|delta| renderer.update_texture(&gpu.device, &gpu.queue, *id, delta));
        }
        freed.extend(&textures.free);
        textures.clear();
    }

    /// Clears a texture of this size to a colour, calls `below` for what is below the overlay, and draws the overlay.
    pub fn draw(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        (target, size): (&wgpu::Texture, [u32; 2]),
        background: wgpu::Color,
        Painted { primitives, pixels_per_point }: &Painted,
        below: impl FnOnce(&mut wgpu::RenderPass<'_>),
    ) {
        let descriptor = ScreenDescriptor { size_in_pixels: size, pixels_per_point: *pixels_per_point };
        // Command buffers come only from paint callbacks, which the overlay does not use.
        let _ = self.renderer.update_buffers(&gpu.device, &gpu.queue, encoder, primitives, &descriptor);
        let ops = wgpu::Operations { load: wgpu::LoadOp::Clear(background), store: wgpu::StoreOp::Store };
        let view = target.create_view(&Default::default());
        let attachment = wgpu::RenderPassColorAttachment { view: &view, depth_slice: None, resolve_target: None, ops };
        let attachments = [Some(attachment)];
        let pass = wgpu::RenderPassDescriptor {
            label: Some("overlay"),
            color_attachments: &attachments,
            ..Default::default()
        };
        let mut pass = encoder.begin_render_pass(&pass).forget_lifetime();
        below(&mut pass);
        let [width, height] = size.map(|n| n as f32);
        pass.set_viewport(0.0, 0.0, width, height, 0.0, 1.0);
        self.renderer.render(&mut pass, primitives, &descriptor);
    }
}
