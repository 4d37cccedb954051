//! Surfaces that an image shows, and where another image shows the same ones: the previous frame, or the other eye.

use crate::image::{Extent, ImageError, RgbImage, check_same_size};

/// Smallest dot product of normals of the same surface: 60 degrees, since normal maps may turn normals by much from
/// pixel to pixel.
const NORMALS_AGREE: f32 = 0.5;

/// Columns and rows between a point and the centres of the pixels around it: less than one, so that rounding of a point
/// on a centre does not add a neighbour.
const NEAR: f64 = 0.999;

/// Surfaces that one eye sees in a frame, per pixel. The fields are auxiliary images of the same names.
#[derive(Clone, Debug, PartialEq)]
pub struct Surfaces {
    extent: Extent,
    position: Vec<[f32; 3]>,
    normal: Vec<[f32; 3]>,
    /// Positions at which the eye sees the surfaces, if they are seen in mirrors or behind glass.
    virtual_position: Option<Vec<[f32; 3]>>,
}

/// Location of a pixel's surface in another image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sighting {
    /// The pixel shows no surface but the sky.
    Sky,
    /// The surface is hidden there, or outside the image.
    Hidden,
    /// Visible in the pixel with this row-major index.
    At(usize),
}

impl Surfaces {
    /// `position` is in world space, in any unit. `normal` is in world space, and zero if there is no surface.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn new(position: RgbImage, normal: RgbImage) -> Result<Self, ImageError> {
        check_same_size(position.extent, normal.extent)?;
        let (extent, position, normal) = (position.extent, position.pixels, normal.pixels);
        Ok(Self { extent, position, normal, virtual_position: None })
    }

    /// Sets the world-space positions at which the eye sees the surfaces in mirrors and behind glass: where both eyes
    /// look for them.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn seen_at(self, virtual_position: RgbImage) -> Result<Self, ImageError> {
        check_same_size(self.extent, virtual_position.extent)?;
        Ok(Self { virtual_position: Some(virtual_position.pixels), ..self })
    }

    pub fn extent(&self) -> Extent {
        self.extent
    }

    pub fn positions(&self) -> &[[f32; 3]] {
        &self.position
    }

    /// Returns where `other` shows each pixel's surface, row-major. For a pixel's index, `expected` returns the point at
    /// which `other` shows the surface if nothing hides it, and the surface's world-space position there. Points have
    /// pixel centres at integers.
    ///
    /// The result is the nearest of the four pixels around that point that shows the same surface: its normal must agree
    /// within 60 degrees, and its position must lie near the plane through the surface's expected position. The allowed
    /// distance from that plane is the pixel spacing on the surface, that is, the distance to the closest position among
    /// the pixel's four neighbours. No threshold thus depends on the scene's scale.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn seen_in(
        &self,
        other: &Self,
        expected: impl Fn(usize) -> ([f64; 2], [f32; 3]),
    ) -> Result<Vec<Sighting>, ImageError> {
        check_same_size(self.extent, other.extent)?;
        let sighting = |i: usize| {
            let normal = self.normal[i];
            if !is_surface(normal) {
                return Sighting::Sky;
            }
            let (point, position) = expected(i);
            let spacing = self.spacing(i);
            let is_same = |j: &usize| {
                let off_plane = dot(normal, sub(other.position[*j], position)).abs();
                dot(normal, other.normal[*j]) > NORMALS_AGREE && off_plane <= spacing
            };
            self.pixels_around(point).into_iter().find(is_same).map_or(Sighting::Hidden, Sighting::At)
        };
        Ok((0..self.extent.area()).map(sighting).collect())
    }

    /// Returns where the other eye shows each pixel's surface, row-major. `world_to_ndc` is the other eye's matrix of
    /// that name, for row vectors; `pixel_centre` is the sample position in each pixel.
    ///
    /// # Errors
    /// [`ImageError::SizeMismatch`].
    pub fn in_other_eye(
        &self,
        other: &Self,
        world_to_ndc: &[[f32; 4]; 4],
        pixel_centre: [f32; 2],
    ) -> Result<Vec<Sighting>, ImageError> {
        self.seen_in(other, |i| {
            let point = self.point_in_other_eye(i, world_to_ndc, pixel_centre);
            (point.unwrap_or([f64::NAN; 2]), self.position[i])
        })
    }

    /// Returns the point at which the other eye sees the surface of pixel `i` if nothing hides it, with pixel centres at
    /// integers; `None` for the sky and for surfaces behind that eye. The parameters are those of
    /// [`Self::in_other_eye`].
    pub fn point_in_other_eye(
        &self,
        i: usize,
        world_to_ndc: &[[f32; 4]; 4],
        pixel_centre: [f32; 2],
    ) -> Option<[f64; 2]> {
        let [x, y, z] = self.virtual_position.as_ref().unwrap_or(&self.position)[i];
        let at = |column: usize| -> f64 {
            [x, y, z, 1.0].iter().zip(world_to_ndc).map(|(c, row)| f64::from(*c) * f64::from(row[column])).sum()
        };
        let size = [self.extent.width, self.extent.height].map(f64::from);
        let w = at(3);
        let is_seen = is_surface(self.normal[i]) && w > 0.0;
        is_seen.then(|| [0, 1].map(|c| at(c) / w * size[c] - f64::from(pixel_centre[c])))
    }

    /// Returns the pixels whose centres are less than one column and one row away from a point: at most four, nearest
    /// first. Non-finite points are near no pixel.
    fn pixels_around(&self, [x, y]: [f64; 2]) -> Vec<usize> {
        let (width, height) = (self.extent.width as usize, self.extent.height as usize);
        let mut found = Vec::new();
        for (column, row) in
            [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(c, r)| (x.floor() + c, y.floor() + r))
        {
            let is_inside = (0.0..width as f64).contains(&column) && (0.0..height as f64).contains(&row);
            if is_inside && (column - x).abs() < NEAR && (row - y).abs() < NEAR {
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
