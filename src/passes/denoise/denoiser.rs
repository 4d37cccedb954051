//! The handle of a denoiser: its name in files and on the command line.

use std::fmt;

use serde::Serializer;

/// A method that removes path tracing noise from a frame. Where denoising is optional, the type is an [`Option`] of
/// this.
///
/// The handle holds the name of the method, by which [`Self::method`] finds the implementation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Denoiser(pub(super) &'static str);

impl Denoiser {
    /// An à-trous filter that uses only the current frame.
    pub const ATROUS: Self = Self("atrous");
    /// An à-trous filter on temporally accumulated illumination, guided by its variance.
    pub const SVGF: Self = Self("svgf");
    /// Blockwise regression (BMFR): fits radiance accumulated over frames to features of surfaces.
    pub const BMFR: Self = Self("bmfr");
    /// BMFR that adds noise to features, instead of dropping linearly dependent ones like [`Self::BMFR`]; for
    /// comparison.
    pub const BMFR_NOISE: Self = Self("bmfr_noise");
    /// Default number of iterations.
    pub const DEFAULT_ITERATIONS: u32 = 5;
    /// Maximum number of iterations.
    pub const MAX_ITERATIONS: u32 = 10;

    /// Returns the denoiser's name in files and on the command line, or `none`.
    pub fn name_of(choice: Option<Self>) -> &'static str {
        choice.map_or("none", |denoiser| denoiser.0)
    }
}

impl fmt::Debug for Denoiser {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

/// Serializes an optional denoiser by its name, or as `none`.
///
/// # Errors
/// Errors of the serializer.
pub fn serialize<S: Serializer>(choice: &Option<Denoiser>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(Denoiser::name_of(*choice))
}
