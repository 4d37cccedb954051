//! Denoisers, which run between path tracing and the finished image.

mod taa;
mod atrous;
mod bmfr;
mod denoised;
mod denoiser;
mod filter;
mod gradient;
pub mod import;
mod method;
mod registry;
pub mod seam_filter;
mod svgf;

pub(super) use denoised::Denoised;
pub use denoiser::Denoiser;
pub(crate) use denoiser::serialize;
pub use filter::Filter;
pub use method::{Denoise, Light, PARTITION};
pub(crate) use registry::deserialize;

/// No denoiser. Light stays as it was traced.
struct Undenoised;

impl Denoise for Undenoised {
    fn name(&self) -> &'static str {
        "none"
    }

    fn help(&self) -> Option<&'static str> {
        None
    }
}

/// Returns the implementation of a denoiser.
pub fn of(denoiser: Option<Denoiser>) -> &'static dyn Denoise {
    denoiser.map_or(&Undenoised, Denoiser::method)
}
