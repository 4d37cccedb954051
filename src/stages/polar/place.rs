//! Positions in polar images.

/// Position of a screen pixel in a polar image, and the density of the image there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarPoint {
    /// Row of the polar image. Rings are counted outwards from the gaze, after the rows of the square, if any.
    pub row: f64,
    /// Pixels of the image per pixel of the screen.
    pub density: f64,
}
