//! Temporal stability of a sequence: flicker and ghosting, with errors tracked along motion vectors.
//!
//! Errors are differences of display values between an image and the reference of the same frame, E(t, p) = image(t, p)
//! − reference(t, p). Motion and light changes that the reference also shows are therefore no error.
//!
//! **Flicker** is the mean over pixels, channels and frames of |E(t, p) − E(t−1, q)|, where q is the pixel of the
//! previous frame that shows the surface at p: the image's change minus the reference's, along the motion. For a static
//! camera q is p. It is 0 for images with the same error in all frames, and 2σ/√π for normal noise of standard
//! deviation σ that is independent between frames. It is the warping error with an occlusion mask of Lai et al. 2018,
//! "Learning Blind Video Temporal Consistency", section 4, with these departures: the reference's own change is
//! subtracted; differences are absolute instead of squared; motion is known instead of estimated; and q is one pixel
//! instead of a bilinear mean, which would hide noise wherever motion is not whole pixels. Among the four pixels around
//! the reprojected point, q is the nearest that shows the same surface, since the nearest of all is often across an
//! edge.
//!
//! **Ghosting** is the RMSE of display values over pixels without q, which cannot have a history, divided by the RMSE
//! over the pixels with one. Trails of moving objects lie in the former. 1 means that they are no worse than other
//! pixels. A temporal filter without trails also exceeds 1, since noise is not averaged where there is no history: use
//! ghosting to compare methods with each other.

use std::iter::Sum;
use std::ops::Add;

use serde::Serialize;

use super::Pair;
use super::rings::Viewing;
use super::surfaces::{Sighting, Surfaces};
use crate::image::{ImageError, RgbImage, check_same_size};

/// Surfaces that one eye sees in a frame, with their motion since the previous frame.
#[derive(Clone, Debug, PartialEq)]
pub struct MovingSurfaces {
    surfaces: Surfaces,
    motion_px: Vec<[f32; 3]>,
    /// World-space positions of the surfaces in the previous frame.
    last_position: Vec<[f32; 3]>,
}

impl MovingSurfaces {
    /// `motion_px` is the previous position minus the current one, x and y in pixels; the third value is ignored.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn new(surfaces: Surfaces, motion_px: RgbImage) -> Result<Self, ImageError> {
        check_same_size(surfaces.extent(), motion_px.extent)?;
        let last_position = surfaces.positions().to_vec();
        Ok(Self { surfaces, motion_px: motion_px.pixels, last_position })
    }

    /// Sets the world-space positions of moving surfaces in the previous frame.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn with_last_position(self, last_position: RgbImage) -> Result<Self, ImageError> {
        check_same_size(self.surfaces.extent(), last_position.extent)?;
        Ok(Self { last_position: last_position.pixels, ..self })
    }

    pub fn surfaces(&self) -> &Surfaces {
        &self.surfaces
    }

    /// Returns where the previous frame shows each pixel's surface, row-major: [`Surfaces::seen_in`] along the motion.
    /// Surfaces that are static or move within their own plane are found.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn history(&self, before: &Self) -> Result<Vec<Sighting>, ImageError> {
        let width = self.surfaces.extent().width as usize;
        self.surfaces.seen_in(&before.surfaces, |i| {
            let [dx, dy, _] = self.motion_px[i].map(f64::from);
            ([(i % width) as f64 + dx, (i / width) as f64 + dy], self.last_position[i])
        })
    }
}

/// Sums from which [`TemporalError`] is computed, over the pixels of all frames that have a previous frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    seen_px: usize,
    new_px: usize,
    /// Sum over channels of absolute changes of the error.
    changes: f64,
    /// Sums over channels of squared errors.
    seen_squares: f64,
    new_squares: f64,
}

impl Pair {
    /// Sums the change of display errors since the previous frame; `history` is from [`MovingSurfaces::history`].
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    ///
    /// # Panics
    /// If `history` does not have one entry per pixel.
    pub fn change_since(&self, before: &Pair, history: &[Sighting]) -> Result<Change, ImageError> {
        check_same_size(self.extent, before.extent)?;
        assert_eq!(history.len(), self.extent.area(), "a history must have one entry per pixel");
        let mut sums = Change::default();
        for (i, history) in history.iter().enumerate() {
            let now = self.display_error(i);
            let squares: f64 = now.iter().map(|e| e * e).sum();
            match *history {
                Sighting::Sky => {}
                Sighting::Hidden => {
                    sums.new_px += 1;
                    sums.new_squares += squares;
                }
                Sighting::At(j) => {
                    sums.seen_px += 1;
                    sums.seen_squares += squares;
                    sums.changes += now.iter().zip(before.display_error(j)).map(|(n, b)| (n - b).abs()).sum::<f64>();
                }
            }
        }
        Ok(sums)
    }

    /// Sums changes like [`Self::change_since`] for a static camera: every pixel, including the sky, shows the same
    /// surface as in the previous frame. If both frames have the same reference, the reference cancels out, and the
    /// result is the change of the image itself.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn change_at_rest(&self, before: &Pair) -> Result<Change, ImageError> {
        let history: Vec<Sighting> = (0..self.extent.area()).map(Sighting::At).collect();
        self.change_since(before, &history)
    }

    /// Sums changes like [`Self::change_at_rest`] over the pixels within `degrees` of the gaze in both frames.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn change_near_gaze(
        &self,
        before: &Pair,
        [viewing, viewing_before]: [&Viewing; 2],
        degrees: f64,
    ) -> Result<Change, ImageError> {
        let angles = self.eccentricities(viewing).zip(self.eccentricities(viewing_before));
        let is_near = |(now, before): (f64, f64)| now.max(before) <= degrees.to_radians();
        let near = |(i, angles)| if is_near(angles) { Sighting::At(i) } else { Sighting::Sky };
        self.change_since(before, &angles.enumerate().map(near).collect::<Vec<_>>())
    }

    pub(super) fn display_error(&self, i: usize) -> [f64; 3] {
        let (r, a) = (self.reference.shown[i], self.image.shown[i]);
        [a[0] - r[0], a[1] - r[1], a[2] - r[2]]
    }
}

impl Add for Change {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            seen_px: self.seen_px + other.seen_px,
            new_px: self.new_px + other.new_px,
            changes: self.changes + other.changes,
            seen_squares: self.seen_squares + other.seen_squares,
            new_squares: self.new_squares + other.new_squares,
        }
    }
}

impl Sum for Change {
    fn sum<I: Iterator<Item = Self>>(changes: I) -> Self {
        changes.fold(Self::default(), Add::add)
    }
}

/// Flicker and ghosting of one eye's sequence, in display values 0 … 1; `None` if undefined.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TemporalError {
    /// Flicker; `None` if no surface was visible in a previous frame.
    pub flicker: Option<f64>,
    /// Ratio of the RMSE of disoccluded surfaces to that of the others; `None` if either set is empty or the latter
    /// RMSE is 0.
    pub ghosting: Option<f64>,
    /// Fraction of surface pixels that are disoccluded; `None` without surfaces.
    pub new_share: Option<f64>,
}

impl From<Change> for TemporalError {
    fn from(sums: Change) -> Self {
        let over = |sum: f64, count: usize| (count > 0).then(|| sum / count as f64);
        let rmse = |squares, pixels| over(squares, 3 * pixels).map(f64::sqrt);
        let [new, seen] = [rmse(sums.new_squares, sums.new_px), rmse(sums.seen_squares, sums.seen_px)];
        Self {
            flicker: over(sums.changes, 3 * sums.seen_px),
            ghosting: new.zip(seen).and_then(|(new, seen)| (seen > 0.0).then_some(new / seen)),
            new_share: over(sums.new_px as f64, sums.new_px + sums.seen_px),
        }
    }
}

#[cfg(test)]
mod tests;
