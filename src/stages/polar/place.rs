//! Places in polar images.

/// Place of a screen pixel in a polar image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarPlace {
    /// Row, counted from the gaze.
    pub row: f64,
    /// Pixels of the image per pixel of the screen.
    pub density: f64,
}
