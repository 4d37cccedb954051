//! Values that make a frame. Nothing here needs a device.

pub mod samples;

pub use samples::Samples;
