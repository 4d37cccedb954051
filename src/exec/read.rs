//! Images of the last whole frame, off the primary.

use super::messages::{Answer, Order, Pixels, Stop};
use super::{ExecError, Renderer, Stereo};
use crate::graph::PhysicalImage;
use crate::image::{Image, RgbImage};
use crate::stages::Aov;

impl Renderer {
    /// Raw, both eyes. If the primary fails, others make the frame again.
    fn read(&mut self, image: PhysicalImage) -> Result<Pixels, ExecError> {
        loop {
            let whole = self.whole.as_ref().ok_or(ExecError::NoFrame)?;
            if let Some(pixels) = whole.images.get(&image) {
                return Ok(pixels.clone());
            }
            // What is on the devices is the next frames'.
            if self.in_flight() > 0 {
                return Err(ExecError::NoFrame);
            }
            let (primary, place, index) = (whole.primary, whole.inputs.place(), whole.inputs.index());
            let limit = self.limit(&whole.inputs);
            let (_, injected) = self.injected.take(primary, index);
            let ticket = self.workers.ask(vec![(primary, Order::Read { image, place, injected })], limit);
            match self.workers.answers(ticket, limit).pop() {
                Some((_, Ok(Answer::Pixels(pixels)))) => return Ok(pixels),
                Some((_, Err(Stop::Device(failure)))) => self.make_again(failure)?,
                _ => return Err(ExecError::Stuck),
            }
        }
    }

    /// The last frame, scene-referred.
    pub fn read_linear(&mut self) -> Result<Stereo<RgbImage>, ExecError> {
        let extent = self.spec.extent;
        let image = |bytes: Vec<u8>| {
            let pixels = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&bytes);
            Image { extent, pixels: pixels.iter().map(|p| [p[0], p[1], p[2]]).collect() }
        };
        let [left, right] = self.read(PhysicalImage::Linear)?.map(image);
        Ok(Stereo { left, right })
    }

    /// The last frame, tonemapped and encoded on the devices.
    pub fn read_display(&mut self) -> Result<Stereo<Image<[u8; 4]>>, ExecError> {
        let extent = self.spec.extent;
        let image = |bytes: Vec<u8>| Image { extent, pixels: bytemuck::pod_collect_to_vec(&bytes) };
        let [left, right] = self.read(PhysicalImage::Display)?.map(image);
        Ok(Stereo { left, right })
    }

    /// The i-th auxiliary image, as many channels as [`Aov::channels`] names.
    pub fn read_aov(&mut self, i: usize) -> Result<Stereo<Vec<Vec<f32>>>, ExecError> {
        let aov: Aov = self.settings.stages.aovs[i];
        let channels = |bytes: Vec<u8>| {
            let pixels = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&bytes);
            (0..aov.channels().len()).map(|c| pixels.iter().map(|p| p[c]).collect()).collect()
        };
        let [left, right] = self.read(PhysicalImage::Aov(i as u8))?.map(channels);
        Ok(Stereo { left, right })
    }
}
