//! What a frame is made from. Nothing here needs a device.

pub mod samples;

pub use samples::Samples;
