//! How good a frame is to be.

mod denoiser;

pub use denoiser::{Denoiser, UnknownDenoiser, or_none};
