//! The overlay's panel in a headset: the contents of the window's panel, on a rectangle in space.

use std::time::{Duration, Instant};

use diptych::headset::{Headset, HeadsetFrame, Panel};
use diptych::image::Extent;

use super::super::overlay::{Overlay, Parts};
use super::super::painter::Painter;
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
    painter: Painter,
    drawn: Option<Instant>,
}

impl PanelQuad {
    /// Opens a panel in front of the head's pose in `frame`; `None` if the headset cannot show panels.
    pub fn open(headset: &Headset, frame: &HeadsetFrame) -> Result<Option<Self>, Failure> {
        let Some(panel) = headset.panel(SIZE, WIDTH_M, frame.head)? else { return Ok(None) };
        let painter = Painter::new(headset.gpu(), panel.format());
        Ok(Some(Self { panel, overlay: Overlay::new(), painter, drawn: None }))
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
        let Self { panel, overlay, painter, .. } = self;
        let (gpu, size) = (headset.gpu(), [SIZE.width, SIZE.height]);
        let parts = Parts { panel: true, help: false, hint: false };
        let (painted, textures) = overlay.paint(size, PIXELS_PER_POINT, look, status, &[], parts);
        painter.take_textures(gpu, textures);
        panel.fill(gpu, |texture, encoder| {
            painter.draw(gpu, encoder, (texture, size), wgpu::Color::TRANSPARENT, &painted, |_| {});
        })?;
        Ok(())
    }
}
