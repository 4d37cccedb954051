//! Settings of a run and parameters of a frame, and the constants that shaders read of them. Nothing here needs a device.

mod config;
pub mod constants;
mod disturb;
mod foveation;
mod params;
mod sampler;
pub mod search_range;
pub mod settings;

pub use config::{Buffers, Execution, RunConfig};
pub use disturb::{Disturbance, Injection};
pub use foveation::Foveation;
pub use params::FrameParams;
pub use sampler::Sampler;
