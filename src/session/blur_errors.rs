//! Measures what the filter's blur costs in error on the view that is played. No formula can know it: in some scenes one
//! iteration has a fifth more error than five, in others a tenth less.

use std::time::Duration;

use super::calibration::{Calibration, CalibrationError};
use crate::control::{BOUNCES, BlurErrors, MOST_ITERATIONS, guessed_relative_cost};
use crate::image::{Extent, Image, RgbImage};
use crate::metrics::Pair;
use crate::quality::{Filter, Quality};

/// Maximum time that the measurement may be expected to take. Slower devices do without it.
const TIME_LIMIT: Duration = Duration::from_secs(2);
/// Frames before any is compared. In the first, the camera moves at [`FPS`].
const SETTLING: u32 = 12;
const MOVING: u32 = 8;
const FPS: f64 = 60.0;
/// Compared frames.
const COMPARED: u32 = 2;
/// Samples per pixel of the reference. Fewer than the least would hide the differences between filters in noise; more
/// than the most would tell little more.
const LEAST_SAMPLES: u32 = 16;
const MOST_SAMPLES: u32 = 64;
/// Samples per pixel of a frame of the reference.
const SAMPLES_AT_ONCE: u32 = 16;
/// Index of the reference's first frame, counted from the first frame of the calibration.
const REFERENCE_FRAMES: u32 = 1 << 10;
/// Size of the middle part of the left eye's image that is compared.
const COMPARED_PART: Extent = Extent::new(240, 160);

impl Calibration<'_> {
    /// Measures the errors with most bounces. Returns `None` if there is no filter with a history and as many iterations,
    /// if the renderer has no frames without a filter, or if the device is too slow.
    pub(super) fn blur_errors(&mut self) -> Result<Option<BlurErrors>, CalibrationError> {
        let timed = |spp| self.timed.get(&(spp, BOUNCES[BOUNCES.len() - 1]));
        let Some((one, two)) = timed(1).zip(timed(2)) else { return Ok(None) };
        let Some(Filter { denoiser, .. }) = one.quality.filter else { return Ok(None) };
        let renders_references = self.renderer.config().envelope.mixes_filter;
        let with_most = Quality { filter: Some(Filter::new(denoiser, MOST_ITERATIONS)), ..one.quality };
        let has_most = denoiser.most_iterations() >= MOST_ITERATIONS
            && (self.limit)(&with_most).most_iterations() == MOST_ITERATIONS;
        if !renders_references || !has_most || !denoiser.method().keeps_history() {
            return Ok(None);
        }
        let sample_ms = (two.makespan_ms - one.makespan_ms).max(two.makespan_ms / 4.0);
        let frames_ms = (one.makespan_ms + two.makespan_ms) * f64::from(2 * (SETTLING + COMPARED));
        let samples = ((TIME_LIMIT.as_secs_f64() * 1e3 - frames_ms) / sample_ms) as u32;
        if samples < LEAST_SAMPLES {
            return Ok(None);
        }
        let [one, two] = [one, two].map(|timed| timed.quality);
        let reference = self.reference(&one, samples.min(MOST_SAMPLES))?;
        let errors = [self.blur_error(&one, &reference)?, self.blur_error(&two, &reference)?];
        Ok(Some(errors).filter(|errors| errors.iter().all(|error| error.is_finite())))
    }

    /// Measures the error of most iterations over that of one.
    fn blur_error(&mut self, quality: &Quality, reference: &RgbImage) -> Result<f64, CalibrationError> {
        let mut error = |iterations| {
            let filter = quality.filter.map(|filter| Filter::new(filter.denoiser, iterations));
            self.error(&Quality { filter, ..*quality }, reference)
        };
        Ok(error(MOST_ITERATIONS)? / error(1)?)
    }

    /// Returns the sum of the FLIP of frames with a history.
    fn error(&mut self, quality: &Quality, reference: &RgbImage) -> Result<f64, CalibrationError> {
        self.renderer.begin_anew();
        let exposure_ev = self.renderer.config().exposure_ev;
        let mut sum = 0.0;
        for index in 0..SETTLING + COMPARED {
            self.render_at(quality, index, index.min(MOVING))?;
            if index >= SETTLING {
                sum += Pair::new(reference, &self.middle()?, exposure_ev).map_or(0.0, |pair| pair.errors().flip);
            }
        }
        Ok(sum)
    }

    /// Renders the mean of frames of many samples without a filter.
    fn reference(&mut self, quality: &Quality, samples: u32) -> Result<RgbImage, CalibrationError> {
        // Without a filter, nothing would fill the pixels that foveal layers leave.
        let quality = Quality { spp: SAMPLES_AT_ONCE.into(), filter: None, fovea: None, ..*quality };
        let frames = samples.div_ceil((self.limit)(&quality).spp.least);
        self.render_at(&quality, REFERENCE_FRAMES, MOVING)?;
        let mut mean = self.middle()?;
        for count in 1..frames {
            self.render_at(&quality, REFERENCE_FRAMES + count, MOVING)?;
            let (image, part) = (self.middle()?, 1.0 / (count + 1) as f32);
            for (mean, value) in mean.pixels.as_flattened_mut().iter_mut().zip(image.pixels.as_flattened()) {
                *mean += (value - *mean) * part;
            }
        }
        Ok(mean)
    }

    /// Renders a frame after the camera has moved for this number of frames.
    fn render_at(&mut self, quality: &Quality, index: u32, moved: u32) -> Result<(), CalibrationError> {
        let time_s = self.view.time_s + f64::from(moved) / FPS;
        self.render(quality, &guessed_relative_cost(quality), self.first_frame + index, time_s).map(drop)
    }

    /// Reads the middle of the left eye's image, at most [`COMPARED_PART`].
    fn middle(&mut self) -> Result<RgbImage, CalibrationError> {
        Ok(middle(self.renderer.read_linear()?.into_left()))
    }
}

fn middle(image: RgbImage) -> RgbImage {
    let Extent { width, height } = image.extent;
    let extent = Extent::new(width.min(COMPARED_PART.width), height.min(COMPARED_PART.height));
    let [left, top] = [(width - extent.width) / 2, (height - extent.height) / 2];
    let row = |y: u32| {
        let begin = ((top + y) * width + left) as usize;
        &image.pixels[begin..begin + extent.width as usize]
    };
    Image { extent, pixels: (0..extent.height).flat_map(row).copied().collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::candidates;
    use crate::quality::{Denoiser, Envelope};
    use crate::session::View;
    use crate::{LoadedScene, Renderer};

    fn blur_errors(name: &str) -> BlurErrors {
        let scene = LoadedScene::load(name).unwrap();
        let all = candidates(Some(Denoiser::SVGF), false);
        let builder = Renderer::builder(&scene).size(64, 36).envelope(Envelope::of(&all).with_unfiltered());
        let mut renderer = builder.build().unwrap();
        let view = View { rig: &scene.shot.rig, time_s: 0.0 };
        let mut calibration = Calibration::new(&mut renderer, &view, &|quality| *quality, &|| false);
        let basic = Quality { bounces: 3, ..Quality::default() };
        let reference = calibration.reference(&basic, MOST_SAMPLES).unwrap();
        [1, 2].map(|spp: u32| {
            let error = calibration.blur_error(&Quality { spp: spp.into(), ..basic }, &reference).unwrap();
            eprintln!("{name}, {spp} spp: {error:.3}");
            error
        })
    }

    /// References of 256 to 512 samples per pixel at 96x54 with 6 bounces give 1.14 and 1.09 in the room, and 0.84 with one
    /// sample in the towers. The noise of this reference hides a part of it.
    #[test]
    fn scenes_differ_in_the_blur_they_want() {
        let (room, towers) = (blur_errors("builtin:cornell"), blur_errors("builtin:towers"));
        assert!(room.iter().all(|error| *error > 1.03), "{room:.3?}");
        assert!(towers.iter().all(|error| *error < 0.98), "{towers:.3?}");
    }

    #[test]
    fn middle_of_an_image_is_compared() {
        let image = |width, height| {
            let pixels = (0..width * height).map(|i| [(i % width) as f32, (i / width) as f32, 0.0]).collect();
            middle(Image { extent: Extent::new(width, height), pixels })
        };
        let small = image(3, 2);
        assert_eq!((small.extent, small.pixels[4]), (Extent::new(3, 2), [1.0, 1.0, 0.0]));
        let wide = image(244, 163);
        assert_eq!((wide.extent, wide.pixels[0], wide.pixels[240]), (COMPARED_PART, [2.0, 1.0, 0.0], [2.0, 2.0, 0.0]));
        assert_eq!(wide.pixels.len(), COMPARED_PART.area());
    }
}
