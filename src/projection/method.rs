//! The interface of a polar projection.

use std::fmt::Display;
use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};

use super::view::View;
use crate::image::Extent;
use crate::wgsl::Declaration;

/// Position of a screen pixel in a polar image, and the density of the image there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolarPoint {
    /// Row of the polar image. Rings are counted outwards from the gaze, after the rows of the square, if any.
    pub row: f64,
    /// Pixels of the image per pixel of the screen.
    pub density: f64,
}

/// A polar projection: its names, its parameters, and the geometry of its images. `screen` is the size of the screen
/// image.
pub trait Project {
    /// Returns the name in `--foveation` and in tables, which never changes.
    fn name(&self) -> &'static str;

    /// Returns the projection's line in the help of `--foveation`.
    fn help(&self) -> &'static str;

    /// Returns the name, without `.inc.wgsl`, of the include that maps pixels to rays and points to pixels.
    fn include(&self) -> &'static str;

    /// Returns the name of the kernel that blurs images with increasing distance from the gaze; `None` without blur.
    fn blur(&self) -> Option<&'static str> {
        None
    }

    /// Returns the declaration of the struct of constants that the include reads as `projection`; `None` if it reads
    /// none.
    fn declaration(&self) -> Option<Declaration> {
        None
    }

    /// Returns the bytes of this struct, which all frames of a run share.
    fn constants(&self, _screen: Extent) -> Vec<u8> {
        Vec::new()
    }

    /// Returns the name with the parameters, if there are any.
    fn label(&self) -> String {
        self.name().to_owned()
    }

    /// Checks whether all parameters are valid.
    ///
    /// # Errors
    /// A message that names the invalid parameter.
    fn check(&self) -> Result<(), OutOfRange> {
        Ok(())
    }

    /// Returns the size of the polar images.
    fn grid(&self, screen: Extent) -> Extent;

    /// Returns an eye's view with `rows` and the projection's own members set. `gaze` is in fractions of the screen;
    /// `view` has its direction.
    fn look(&self, view: View, gaze: [f64; 2], screen: Extent) -> View;

    /// Returns the number of pixels that an eye's polar image uses. The other pixels of [`Self::grid`] are unused.
    fn pixels(&self, view: &View, screen: Extent) -> u64;

    /// Returns the number of traced pixels of an eye's polar image.
    fn traced(&self, view: &View, screen: Extent) -> u64 {
        self.pixels(view, screen)
    }

    /// Returns a function that maps a point of the screen, in pixels, and its direction to the position in an eye's
    /// polar image.
    fn places(&self, view: View, screen: Extent) -> Box<dyn Fn(DVec2, DVec3) -> PolarPoint>;

    /// Returns an upper bound of the rows by which a surface moved in an eye's image since the previous frame. `shift`
    /// bounds the angle in radians, seen from the eye, by which steps of the eye and the surface's own motion shift it.
    /// By default, a surface may be on any row unless everything is still: near the gaze, even small motion may span
    /// many rows.
    fn rows_moved(&self, now: &View, last: &View, shift: f64) -> f64 {
        if now == last && shift == 0.0 { 0.0 } else { f64::INFINITY }
    }
}

/// A number outside its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name} {value} is out of range{range}")]
pub struct OutOfRange {
    pub name: String,
    pub value: String,
    /// The range as the end of a message; empty if it has no limits that matter.
    pub range: String,
}

/// Checks that a value is in its range.
pub(crate) fn within<T: PartialOrd + Display>(
    name: &str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<(), OutOfRange> {
    match range.contains(&value) {
        true => Ok(()),
        false => {
            let limits = format!(": give {} to {}", range.start(), range.end());
            let range = if limits.len() < 32 { limits } else { String::new() };
            Err(OutOfRange { name: name.to_owned(), value: value.to_string(), range })
        }
    }
}
