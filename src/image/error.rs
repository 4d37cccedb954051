//! Errors of reading, writing and comparing images.

use std::io;
use std::path::PathBuf;

use super::Extent;

#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    #[error("cannot read {path}: check that the file exists and that you may read it")]
    Read { path: PathBuf, source: io::Error },

    #[error("cannot write {path}: check that its folder exists, that you may write there and that the disk has room")]
    Write { path: PathBuf, source: io::Error },

    #[error("{path} is not an OpenEXR image this program can read ({reason}): check that the file is whole")]
    Decode { path: PathBuf, reason: String },

    #[error(
        "{path} is an OpenEXR image of a kind this program does not read ({what}): save it flat, with ZIP compression"
    )]
    Unsupported { path: PathBuf, what: String },

    #[error("reading {path} needs {needed} bytes of memory, more than are available")]
    TooLarge { path: PathBuf, needed: u64 },

    #[error("{path} has no colour: check that it has channels R, G and B, Y, or a single channel; it has {channels}")]
    NoColour { path: PathBuf, channels: String },

    #[error("{path} has no channels {wanted}, only {channels}: check that this is the right image")]
    NoChannels { path: PathBuf, wanted: String, channels: String },

    #[error("the images differ in size, {first} and {second}: check that both were rendered at the same size")]
    SizeMismatch { first: Extent, second: Extent },

    #[error("images of {0} have no pixels to compare")]
    NoPixels(Extent),
}

/// Fails unless both images have the same extent.
pub fn check_same_size(first: Extent, second: Extent) -> Result<(), ImageError> {
    if first == second { Ok(()) } else { Err(ImageError::SizeMismatch { first, second }) }
}
