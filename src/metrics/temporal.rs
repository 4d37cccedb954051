//! Whether a sequence flickers or trails: its error from frame to frame, followed along the surfaces.
//!
//! What an image is held against is a reference of the same frame, and all errors are differences of display values,
//! E(t, p) = image(t, p) − reference(t, p). So what moves, turns or changes its light in the reference too is no error.
//!
//! **Flicker** is the mean over pixels, channels and frames of |E(t, p) − E(t−1, q)|, where q is the pixel of the frame
//! before that shows what p shows now: the change of the image less that of the reference, along the motion. For a
//! resting camera q is p. It is 0 for images that are wrong in the same way in all frames, and 2σ/√π for normal noise of
//! standard deviation σ that frames do not share. It is the warping error with a mask of what was hidden of Lai et al.
//! 2018, "Learning Blind Video Temporal Consistency", section 4, with these departures: the reference's own change is
//! taken off, differences are absolute instead of squared, the motion is known instead of estimated, and q is one pixel
//! instead of a bilinear mean, which would hide noise wherever motion is not whole pixels. It is the nearest of the four
//! around the point that motion leads to which shows the same surface: the nearest of all is often across an edge.
//!
//! **Ghosting** is the RMSE of display values over pixels that have no q, and so cannot have a history, over the RMSE of
//! those that have one. Trails of what has moved away lie in the former. 1 says that they are no worse than elsewhere.
//! A temporal filter that does not trail is above 1 as well, as noise is not averaged where there is no history: hold
//! methods against each other.

use std::iter::Sum;
use std::ops::Add;

use serde::Serialize;

use super::Pair;
use super::rings::Viewing;
use crate::image::{Extent, ImageError, RgbImage, check_same_size};

/// A dot product of normals below this is of different surfaces: 60 degrees, as normal maps may turn them by much from
/// pixel to pixel.
const NORMALS_AGREE: f32 = 0.5;

/// What a frame of one eye shows, by pixel: the auxiliary images of those names.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    extent: Extent,
    motion_px: Vec<[f32; 3]>,
    position: Vec<[f32; 3]>,
    /// Where surfaces were in the frame before.
    last_position: Vec<[f32; 3]>,
    normal: Vec<[f32; 3]>,
}

/// Where a pixel's surface was seen in the frame before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum History {
    /// Nothing is known of the motion of what has no surface.
    Sky,
    /// Nowhere: it was hidden or outside the image.
    New,
    /// In this pixel, row-major.
    Seen(usize),
}

impl Surfaces {
    /// `motion_px`: where each surface was in the frame before minus where it is, x and y in pixels, the third value is
    /// ignored. `position`: world space, any unit. `normal`: world space; without length where there is no surface.
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

    /// Of surfaces that were somewhere else in the frame before, in world space.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn with_last_position(self, last_position: RgbImage) -> Result<Self, ImageError> {
        check_same_size(self.extent, last_position.extent)?;
        Ok(Self { last_position: last_position.pixels, ..self })
    }

    /// Where each pixel's surface was in the frame before, row-major.
    ///
    /// The motion leads from the pixel's centre to between four pixels of `before`; taken is the nearest that shows the
    /// same surface. That is one whose normal agrees within 60 degrees and whose position lies no farther off the plane
    /// through where the surface was than pixels are apart on it: the least distance to the position of one of the four
    /// neighbours, so that no scale has to be chosen. This takes surfaces that rest, or move within their plane.
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

    /// The pixels, at most four, less than one column and row from where the motion leads, nearest first.
    fn pixels_before(&self, i: usize) -> Vec<usize> {
        let (width, height) = (self.extent.width as usize, self.extent.height as usize);
        let [dx, dy, _] = self.motion_px[i].map(f64::from);
        // Pixel centres are whole numbers here. What is not finite is near no pixel.
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

    /// Distance to the nearest neighbour's position; infinite without neighbours.
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

/// Sums over the pixels of frames that have one before them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    seen_px: usize,
    new_px: usize,
    /// Sum over channels of the error's absolute change.
    changes: f64,
    /// Sums over channels of squared errors.
    seen_squares: f64,
    new_squares: f64,
}

impl Pair {
    /// How the error of display values has changed since the frame before; `history` is of [`Surfaces::history`].
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    ///
    /// # Panics
    /// For a history of images of another size.
    pub fn change_since(&self, before: &Pair, history: &[History]) -> Result<Change, ImageError> {
        check_same_size(self.extent, before.extent)?;
        assert_eq!(history.len(), self.extent.area(), "a history is of every pixel");
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

    /// [`Self::change_since`] while the camera stands still: every pixel shows what it did in the frame before, the sky as
    /// well. Where both are held against one reference, it cancels, and the change is the image's alone.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn change_at_rest(&self, before: &Pair) -> Result<Change, ImageError> {
        let history: Vec<History> = (0..self.extent.area()).map(History::Seen).collect();
        self.change_since(before, &history)
    }

    /// [`Self::change_at_rest`] of the pixels within `degrees` of where the eye looks both now and in the frame before.
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

/// Flicker and ghosting of a sequence of one eye; display values, 0 … 1. What is undefined is `None`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TemporalError {
    /// `None` where no surface was seen in a frame before.
    pub flicker: Option<f64>,
    /// RMSE of surfaces not seen in the frame before over that of those seen; `None` without either, or where the latter
    /// are right.
    pub ghosting: Option<f64>,
    /// Pixels of surfaces not seen in the frame before over pixels of surfaces; `None` without any.
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
