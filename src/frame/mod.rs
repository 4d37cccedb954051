//! Settings of a run and parameters of a frame, and the constants that shaders read of them. Nothing here needs a device.

mod config;
pub mod constants;
mod foveation;
mod params;
pub mod search_range;
pub mod settings;

pub use config::{Buffers, Execution, RunConfig, Sampler};
pub use foveation::Foveation;
pub use params::FrameParams;
