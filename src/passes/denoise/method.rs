//! The interface of a denoiser, and the illumination images that its passes read and write.

use glam::UVec4;

use super::denoiser::Denoiser;
use crate::graph::{Image, Partition, Pass, Resource};
use crate::passes::resources::RADIANCE;
use crate::passes::{FrameSpec, tonemap};
use crate::scene::rig::Eye;

/// Partition of all denoiser passes, which therefore have the same stripes.
pub const PARTITION: Partition = Partition("denoise");

const FILTERED: Resource = Resource::image::<UVec4>("filtered");

/// Tracks which image holds the demodulated illumination (reflected light over albedo) while passes are declared: each
/// pass reads the current image and writes the next one.
#[derive(Clone, Copy, Debug)]
pub struct Light {
    current: Image,
    /// The version of the filtered image that was written last.
    filtered: Image,
    /// True if a pass has taken over filtered light for a part of the pixels.
    is_partly_finished: bool,
}

impl Light {
    pub(super) fn traced() -> Self {
        Self { current: RADIANCE.into(), filtered: FILTERED.into(), is_partly_finished: false }
    }

    /// Returns the image that the latest of these passes writes. At first, it is the path tracer's output.
    pub fn image(self) -> Image {
        self.current
    }

    /// Returns the image that the next pass reads and the image that it writes, in this order.
    pub fn advance(&mut self) -> (Image, Image) {
        self.filtered = self.filtered.next();
        self.advance_to(self.filtered)
    }

    /// Returns true if the filter finds pixels whose light has been filtered already.
    pub fn is_partly_finished(self) -> bool {
        self.is_partly_finished
    }

    /// Returns the images like [`Self::advance`], for a pass that takes over filtered light.
    pub fn finish_part(&mut self) -> (Image, Image) {
        self.is_partly_finished = true;
        self.advance()
    }

    /// Returns the images like [`Self::advance`], but the pass writes to `target`.
    pub fn advance_to(&mut self, target: Image) -> (Image, Image) {
        if target.resource == FILTERED {
            self.filtered = target;
        }
        (std::mem::replace(&mut self.current, target), target)
    }
}

/// A denoiser: its properties, and its passes on one view.
pub trait Denoise: Sync {
    /// Returns the name in files and on the command line, which never changes.
    fn name(&self) -> &'static str;

    /// Returns the denoiser's line in `--help`, or `None` to leave the denoiser out of the help.
    fn help(&self) -> Option<&'static str>;

    /// Returns true if the denoiser reuses results of previous frames.
    fn keeps_history(&self) -> bool {
        false
    }

    /// Returns true if the filter needs the variance of samples.
    fn needs_variance(&self) -> bool {
        false
    }

    /// Returns true if the filter reads light as `split.inc.wgsl` packs it: specular apart from diffuse radiance in scenes
    /// that have both, and channels that a surface does not reflect marked as absent. Otherwise, the light is one RGB
    /// colour in floats, and 0 in such channels. A filter that averages these zeros darkens the surfaces around them.
    /// In either case, the unit of light is that of `storage_scale`, in which white is near 1.
    fn filters_lobes(&self) -> bool {
        false
    }

    /// Returns true if the filter leaves pixels alone whose light has been filtered already.
    fn leaves_finished_light(&self) -> bool {
        false
    }

    /// Returns true if specular light of narrow lobes bypasses the filter, because it would blur reflections.
    fn leaves_out_narrow_lobes(&self) -> bool {
        false
    }

    /// Returns the image that has the number of accumulated frames of each pixel in the upper 8 bits of its fourth word,
    /// for the auxiliary image `history`; `None` if the denoiser does not count frames.
    fn frame_counts(&self) -> Option<Resource> {
        None
    }

    /// Returns the maximum number of iterations of a frame.
    fn most_iterations(&self) -> u32 {
        Denoiser::MAX_ITERATIONS
    }

    /// Estimates the FLIP that noise and blur leave at this number of samples per pixel after one iteration, for the
    /// built-in ladder. The default is for a filter that uses only the current frame.
    fn estimated_flip(&self, samples: f64) -> f64 {
        0.18 * samples.powf(-0.35)
    }

    /// Estimates the FLIP after five iterations over that after one.
    fn estimated_blur(&self) -> f64 {
        0.58
    }

    /// Returns the passes before the filter, such as temporal accumulation.
    fn before(&self, _spec: &FrameSpec, _view: Eye, _light: &mut Light) -> Vec<Pass> {
        Vec::new()
    }

    /// Returns the passes of the filter. Each reads the output of the previous pass, including rows around its own. The
    /// halo plan decides before which of these passes devices receive the rows around their own.
    fn filter(&self, _spec: &FrameSpec, _view: Eye, _light: &mut Light) -> Vec<Pass> {
        Vec::new()
    }

    /// Returns the passes that turn filtered illumination into the frame's outputs.
    fn finish(&self, spec: &FrameSpec, view: Eye, light: &mut Light) -> Vec<Pass> {
        vec![tonemap::pass(spec, view, light.image())]
    }
}
