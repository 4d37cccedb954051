//! The filter of a frame: a denoiser and its iterations.

use super::denoiser::Denoiser;

/// How a frame is denoised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    pub denoiser: Denoiser,
    /// Iterations in the inner, middle and outer foveal layer; at least one in the layer that has the most.
    pub iterations: [u32; 3],
}

impl Filter {
    /// SVGF with the default number of iterations.
    pub const DEFAULT: Self = Self { denoiser: Denoiser::SVGF, iterations: [Denoiser::DEFAULT_ITERATIONS; 3] };

    /// Returns a filter with this number of iterations in all layers, or with the denoiser's maximum if that is less.
    pub fn new(denoiser: Denoiser, iterations: u32) -> Self {
        Self { denoiser, iterations: [iterations.min(denoiser.most_iterations()); 3] }
    }

    /// Returns the filter that a choice of a denoiser and iterations stand for: `None` without a denoiser, and if no
    /// layer has iterations.
    pub fn in_effect(choice: Option<Denoiser>, iterations: [u32; 3]) -> Option<Self> {
        choice.filter(|_| iterations != [0; 3]).map(|denoiser| Self { denoiser, iterations })
    }

    /// Returns the largest number of iterations of any foveal layer.
    pub fn most_iterations(self) -> u32 {
        let [inner, middle, outer] = self.iterations;
        inner.max(middle).max(outer)
    }
}
