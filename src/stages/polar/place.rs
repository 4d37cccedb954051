//! Places in polar images.

/// Where a pixel of the screen is in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarPlace {
    /// In rows from the first, which is the gaze's.
    pub row: f64,
    /// Pixels of the image in a pixel of the screen.
    pub density: f64,
}
