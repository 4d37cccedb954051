//! The overlay's panel in a headset: the contents of the window's panel, on a rectangle in space.

use std::time::{Duration, Instant};

use diptych::headset::{Headset, HeadsetFrame, Panel};
use diptych::image::Extent;
use egui_wgpu::{RendererOptions, ScreenDescriptor};

use super::super::overlay::{Overlay, Painted, Parts};
use super::super::shared::Status;
use super::super::status::ViewStatus;
use crate::failure::Failure;

/// Size of the panel, pixels.
const SIZE: Extent = Extent { width: 800, height: 360 };
/// Pixels per point of text.
const PIXELS_PER_POINT: f32 = 2.0;
/// Width of the panel in space, metres.
const WIDTH_M: f64 = 0.6;
/// Minimum time between redraws: on a software adapter, drawing takes time from the devices that render.
const INTERVAL: Duration = Duration::from_millis(200);

pub struct PanelQuad {
    panel: Panel,
    overlay: Overlay,
    renderer: egui_wgpu::Renderer,
    /// Textures to free at the next redraw.
    freed: Vec<egui::TextureId>,
    drawn: Option<Instant>,
}

impl PanelQuad {
    /// Opens a panel in front of the head's pose in `frame`; `None` if the headset cannot show panels.
    pub fn open(headset: &Headset, frame: &HeadsetFrame) -> Result<Option<Self>, Failure> {
        let Some(panel) = headset.panel(SIZE, WIDTH_M, frame.head)? else { return Ok(None) };
        let options = RendererOptions { dithering: false, ..Default::default() };
        let renderer = egui_wgpu::Renderer::new(&headset.gpu().device, panel.format(), options);
        Ok(Some(Self { panel, overlay: Overlay::new(), renderer, freed: Vec::new(), drawn: None }))
    }

    /// Returns the panel, after redrawing it if [`INTERVAL`] has passed; `None` before the first frame.
    pub fn panel(&mut self, headset: &Headset, look: &ViewStatus, status: &Status) -> Result<Option<&Panel>, Failure> {
        if self.drawn.is_none_or(|drawn| drawn.elapsed() >= INTERVAL) && !status.frames.is_empty() {
            self.drawn = Some(Instant::now());
            self.draw(headset, look, status)?;
        }
        Ok(self.drawn.is_some().then_some(&self.panel))
    }

    fn draw(&mut self, headset: &Headset, look: &ViewStatus, status: &Status) -> Result<(), Failure> {
        let Self { panel, overlay, renderer, freed, .. } = self;
        let size = [SIZE.width, SIZE.height];
        let parts = Parts { panel: true, help: false, hint: false };
        let (painted, mut textures) = overlay.paint(size, PIXELS_PER_POINT, look, status, &[], parts);
        let Painted { primitives, pixels_per_point } = painted;
        let gpu = headset.gpu();
        freed.drain(..).for_each(|id| renderer.free_texture(&id));
        for (id, deltas) in &textures.set {
            deltas.iter().for_each(|delta| renderer.update_texture(&gpu.device, &gpu.queue, *id, delta));
        }
        freed.extend(&textures.free);
        textures.clear();
        let descriptor = ScreenDescriptor { size_in_pixels: size, pixels_per_point };
        panel.fill(gpu, |texture, encoder| {
            // Command buffers come only from paint callbacks, which the overlay does not use.
            let _ = renderer.update_buffers(&gpu.device, &gpu.queue, encoder, &primitives, &descriptor);
            let view = texture.create_view(&Default::default());
            let ops =
                wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store };
            let attachment =
                wgpu::RenderPassColorAttachment { view: &view, depth_slice: None, resolve_target: None, ops };
            let descriptor_of_pass = wgpu::RenderPassDescriptor {
                label: Some("panel"),
                color_attachments: &[Some(attachment)],
                ..Default::default()
            };
            let mut pass = encoder.begin_render_pass(&descriptor_of_pass).forget_lifetime();
            renderer.render(&mut pass, &primitives, &descriptor);
        })?;
        Ok(())
    }
}
