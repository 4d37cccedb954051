//! Readback of the last complete frame's images from the primary.

use std::borrow::Cow;
use std::sync::Arc;

use bytemuck::Pod;

use super::messages::Pixels;
use super::output::Output;
use super::{ExecError, PerView, Renderer};
use crate::graph::{FrameGraph, Resource};
use crate::image::{Image, RgbImage};
use crate::passes::tonemap::{DISPLAY, LINEAR};
use crate::passes::{Aov, aov_image};

impl Renderer {
    /// Reads an image of all views as raw bytes. If the primary fails, the other devices render the frame again.
    fn read(&mut self, image: Resource) -> Result<Cow<'_, Pixels>, ExecError> {
        let output = Output::from(image);
        loop {
            let is_here = self.frames.whole.as_ref().is_some_and(|w| w.images.contains_key(&output));
            if is_here {
                let found = self.frames.whole.as_ref().and_then(|w| w.images.get(&output));
                return found.map(Cow::Borrowed).ok_or(ExecError::NoFrame);
            }
            let begin_ms = self.frames.now_ms();
            match self.frames.fetch(output.clone())? {
                Ok(pixels) => return Ok(Cow::Owned(pixels)),
                Err(failure) => self.render_again(failure, begin_ms)?,
            }
        }
    }

    /// Reads an output of the last frame's passes: the bytes of each view's image, row after row.
    ///
    /// # Errors
    /// Errors of [`Self::read_linear`]; also [`ExecError::NoFrame`] if `image` is not an output of the frame.
    pub fn read_output(&mut self, image: Resource) -> Result<PerView<Vec<u8>>, ExecError> {
        let is_output = |(_, graph): &(_, Arc<FrameGraph>)| {
            graph.program.outputs().any(|number| graph.program.images()[number].resource == image)
        };
        if !self.planned.as_ref().is_some_and(is_output) {
            return Err(ExecError::NoFrame);
        }
        Ok(self.read(image)?.into_owned().into_iter().collect())
    }

    /// Returns true if there is a frame whose images can be read.
    pub fn has_frame(&self) -> bool {
        self.frames.whole.is_some()
    }

    /// Returns the device that was the last frame's primary (0 unless a device has failed), and its buffers that hold
    /// the output `image` of all views, in the layout of [`Self::read_output`]. The buffers keep their contents until
    /// another frame begins. Returns `None` if the primary is on another rank.
    ///
    /// # Errors
    /// [`ExecError::NoFrame`] if no frame is complete, frames are in flight, or the last frame did not gather this
    /// output.
    pub fn output_buffers(&self, image: Resource) -> Result<Option<(usize, PerView<wgpu::Buffer>)>, ExecError> {
        let image = Output::from(image);
        let whole = self.frames.complete_with(&image)?;
        Ok(whole.buffers.get(&image).cloned().map(|buffers| (whole.primary, buffers.into_iter().collect())))
    }

    /// Reads all views' images of the last frame in scene-referred linear RGB.
    ///
    /// # Errors
    /// [`ExecError::NoFrame`] if no frame is complete, or frames are in flight and the image was not requested;
    /// [`ExecError::NoneLeft`] if the last device failed.
    pub fn read_linear(&mut self) -> Result<PerView<RgbImage>, ExecError> {
        let extent = self.config.buffers.extent;
        let pixels = self.read(LINEAR)?;
        let image =
            |bytes: &Vec<u8>| Image { extent, pixels: values(bytes).map(|[r, g, b, _]: [f32; 4]| [r, g, b]).collect() };
        Ok(pixels.iter().map(image).collect())
    }

    /// Reads all views' display images of the last frame, tonemapped and encoded on the devices, with 4 bytes per
    /// pixel.
    ///
    /// # Errors
    /// Errors of [`Self::read_linear`].
    pub fn read_display(&mut self) -> Result<PerView<Image<[u8; 4]>>, ExecError> {
        let extent = self.config.buffers.extent;
        let pixels = self.read(DISPLAY)?;
        Ok(pixels.iter().map(|bytes| Image { extent, pixels: values(bytes).collect() }).collect())
    }

    /// Reads the i-th auxiliary image (AOV) of the configuration. Returns for each view the values of all pixels per
    /// channel, in the order of [`Aov::channels`].
    ///
    /// # Errors
    /// Errors of [`Self::read_linear`].
    pub fn read_aov(&mut self, i: usize) -> Result<PerView<Vec<Vec<f32>>>, ExecError> {
        let aov: Aov = self.config.buffers.aovs[i];
        let pixels = self.read(aov_image(i as u8))?;
        let channel = |bytes: &Vec<u8>, c: usize| values(bytes).map(|pixel: [f32; 4]| pixel[c]).collect();
        let channels = |bytes: &Vec<u8>| (0..aov.channels().len()).map(|c| channel(bytes, c)).collect();
        Ok(pixels.iter().map(channels).collect())
    }

    /// Reads the i-th auxiliary image like [`Self::read_aov`], but returns all channels of a pixel, then the next pixel.
    ///
    /// # Errors
    /// Errors of [`Self::read_linear`].
    pub fn read_aov_pixels(&mut self, i: usize) -> Result<PerView<Vec<f32>>, ExecError> {
        let count = self.config.buffers.aovs[i].channels().len();
        let pixels = self.read(aov_image(i as u8))?;
        let channels = |bytes: &Vec<u8>| {
            let mut channels = Vec::with_capacity(bytes.len() / size_of::<[f32; 4]>() * count);
            values(bytes).for_each(|pixel: [f32; 4]| channels.extend_from_slice(&pixel[..count]));
            channels
        };
        Ok(pixels.iter().map(channels).collect())
    }
}

/// Returns the pixels of an image, whose bytes need not be aligned.
fn values<T: Pod>(bytes: &[u8]) -> impl Iterator<Item = T> {
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned)
}
