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
use crate::image::{Extent, ImageError, RgbImage, check_same_size};

/// Smallest dot product of normals of the same surface: 60 degrees, since normal maps may turn normals by much from
/// pixel to pixel.
const NORMALS_AGREE: f32 = 0.5;

/// Surfaces that one eye sees in a frame, per pixel. The fields are auxiliary images of the same names.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    extent: Extent,
    motion_px: Vec<[f32; 3]>,
    position: Vec<[f32; 3]>,
    /// World-space positions of the surfaces in the previous frame.
    last_position: Vec<[f32; 3]>,
    normal: Vec<[f32; 3]>,
}

/// Location of a pixel's surface in the previous frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum History {
    /// The pixel shows no surface but the sky, whose motion is unknown.
    Sky,
    /// Disoccluded: the surface was hidden or outside the image.
    New,
    /// Visible in the pixel with this row-major index.
    Seen(usize),
}

impl Surfaces {
    /// Collects a frame's surfaces. `motion_px` is the previous position minus the current one, x and y in pixels; the
    /// third value is ignored. `position` is in world space, in any unit. `normal` is in world space, and zero if there
    /// is no surface.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn new(motion_px: RgbImage, position: RgbImage, normal: RgbImage) -> Result<Self, ImageError> {
        let extent = position.extent;
        check_same_size(extent, motion_px.extent)?;
        check_same_size(extent, normal.extent)?;
        let last_position = position.pixels.clone();
        let (motion_px, position) = (motion_px.pixels, position.pixels);
        Ok(Self { extent, motion_px, position, last_position, normal: normal.pixels })
    }

    /// Sets the world-space positions of moving surfaces in the previous frame.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn with_last_position(self, last_position: RgbImage) -> Result<Self, ImageError> {
        check_same_size(self.extent, last_position.extent)?;
        Ok(Self { last_position: last_position.pixels, ..self })
    }

    /// Returns the location of each pixel's surface in the previous frame, row-major.
    ///
    /// Motion leads from the pixel's centre to a point between four pixels of `before`. The result is the nearest of
    /// the four that shows the same surface: its normal must agree within 60 degrees, and its position must lie near
    /// the plane through the surface's previous position. The allowed distance from that plane is the pixel spacing on
    /// the surface, that is, the distance to the closest position among the pixel's four neighbours. No threshold thus
    /// depends on the scene's scale. Surfaces that are static or move within their own plane pass this test.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn history(&self, before: &Surfaces) -> Result<Vec<History>, ImageError> {
        check_same_size(self.extent, before.extent)?;
        Ok((0..self.extent.area()).map(|i| self.history_of(i, before)).collect())
    }

    fn history_of(&self, i: usize, before: &Surfaces) -> History {
        let normal = self.normal[i];
        if !is_surface(normal) {
            return History::Sky;
        }
        let spacing = self.spacing(i);
        let is_same = |j: &usize| {
            let off_plane = dot(normal, sub(before.position[*j], self.last_position[i])).abs();
            dot(normal, before.normal[*j]) > NORMALS_AGREE && off_plane <= spacing
        };
        self.pixels_before(i).into_iter().find(is_same).map_or(History::New, History::Seen)
    }

    /// Returns the pixels whose centres are less than one column and one row away from the reprojected point: at most
    /// four, nearest first.
    fn pixels_before(&self, i: usize) -> Vec<usize> {
        let (width, height) = (self.extent.width as usize, self.extent.height as usize);
        let [dx, dy, _] = self.motion_px[i].map(f64::from);
        // In these coordinates, pixel centres are at integers. Non-finite points are near no pixel.
        let (x, y) = ((i % width) as f64 + dx, (i / width) as f64 + dy);
        let mut found = Vec::new();
        for (column, row) in
            [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(c, r)| (x.floor() + c, y.floor() + r))
        {
            let is_inside = (0.0..width as f64).contains(&column) && (0.0..height as f64).contains(&row);
            if is_inside && (column - x).abs() < 1.0 && (row - y).abs() < 1.0 {
                found.push((f64::hypot(column - x, row - y), row as usize * width + column as usize));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.into_iter().map(|(_, j)| j).collect()
    }

    /// Returns the distance to the nearest position among the four neighbours; infinite without neighbours.
    fn spacing(&self, i: usize) -> f32 {
        let width = self.extent.width as usize;
        let column = i % width;
        let neighbours = [
            (column > 0).then(|| i - 1),
            (column + 1 < width).then_some(i + 1),
            i.checked_sub(width),
            (i + width < self.position.len()).then_some(i + width),
        ];
        let surfaces = neighbours.into_iter().flatten().filter(|&j| is_surface(self.normal[j]));
        let distances = surfaces.map(|j| sub(self.position[j], self.position[i])).map(|v| dot(v, v).sqrt());
        distances.fold(f32::INFINITY, f32::min)
    }
}

fn is_surface(normal: [f32; 3]) -> bool {
    dot(normal, normal) > 0.0
}

fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
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
    /// Sums the change of display errors since the previous frame; `history` is from [`Surfaces::history`].
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    ///
    /// # Panics
    /// If `history` does not have one entry per pixel.
    pub fn change_since(&self, before: &Pair, history: &[History]) -> Result<Change, ImageError> {
        check_same_size(self.extent, before.extent)?;
        assert_eq!(history.len(), self.extent.area(), "a history must have one entry per pixel");
        let mut sums = Change::default();
        for (i, history) in history.iter().enumerate() {
            let now = self.display_error(i);
            let squares: f64 = now.iter().map(|e| e * e).sum();
            match *history {
                History::Sky => {}
                History::New => {
                    sums.new_px += 1;
                    sums.new_squares += squares;
                }
                History::Seen(j) => {
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
        let history: Vec<History> = (0..self.extent.area()).map(History::Seen).collect();
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
        let near = |(i, angles)| if is_near(angles) { History::Seen(i) } else { History::Sky };
        self.change_since(before, &angles.enumerate().map(near).collect::<Vec<_>>())
    }

    fn display_error(&self, i: usize) -> [f64; 3] {
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
