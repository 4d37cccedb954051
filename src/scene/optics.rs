//! Asymmetric and canted eye projections, like those of headsets.
//!
//! Reprojection needs both eyes on the same rows. Such eyes are therefore rendered as a rectified frame: two images of
//! the same orientation, with the baseline along their right vector, and with the same symmetric field of view, which
//! covers both eyes' (Fusiello, Trucco & Verri 2000, "A compact algorithm for rectification of stereo pairs"). An eye
//! and its rectified image have the same centre of projection, so a homography maps one to the other.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::eye::Eye;
use crate::image::Extent;

/// Angles of the four sides of a field of view, radians from the eye's axis, positive to the right and upwards, like
/// OpenXR's `XrFovf`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fov {
    pub left: f64,
    pub right: f64,
    pub up: f64,
    pub down: f64,
}

/// Pose of an eye in its head, and its field of view. The head's axes are x to the right, y up and −z ahead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadEye {
    pub position_m: [f64; 3],
    /// Rotation from the eye's axes to the head's, as a unit quaternion (x, y, z, w).
    pub orientation: [f64; 4],
    pub fov: Fov,
}

/// Both eyes of a head.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadEyes {
    pub left: HeadEye,
    pub right: HeadEye,
}

/// Projection of an eye's image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Right, up and forward vectors of the eye as columns, in the axes of its rig.
    pub axes: DMat3,
    /// Tangents of the angles of the field of view's four sides.
    pub tan: Fov,
}

/// Projections of a rig's eyes, for eyes that do not have the projection of the rendered frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Optics {
    pub lenses: [Lens; 2],
    /// Tangents of half the rectified frame's field of view, horizontal and vertical.
    pub tan_half: [f64; 2],
}

/// Eyes and the rectified frame that they share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectified {
    pub optics: Optics,
    /// Position of the rig in the head, midway between the eyes; metres.
    pub position_m: DVec3,
    /// Rotation from the rig's axes, with −z ahead, to the head's.
    pub orientation: DQuat,
    pub baseline_m: f64,
}

/// Largest half-angle of a rectified frame in degrees: planar images grow without bound towards 90 degrees.
const WIDEST_DEG: f64 = 80.0;
/// Smallest allowed cosine of the angle between the baseline and the head's right vector.
const LEAST_COS_RIGHT: f64 = 0.5;

impl HeadEye {
    /// Returns a description of the first fault, if any.
    fn fault(&self) -> Option<&'static str> {
        let Fov { left, right, up, down } = self.fov;
        let fov = [left, right, up, down];
        if !fov.iter().chain(&self.position_m).chain(&self.orientation).all(|v| v.is_finite()) {
            return Some("its numbers must be finite");
        }
        let is_angle = |angle: &f64| angle.abs() <= WIDEST_DEG.to_radians();
        if !(left < right && down < up && fov.iter().all(is_angle)) {
            return Some("fov must have left below right and down below up, in radians within 80 degrees");
        }
        let length = DQuat::from_array(self.orientation).length();
        ((length - 1.0).abs() > 1e-2).then_some("orientation must be of length 1")
    }

    fn orientation(&self) -> DQuat {
        DQuat::from_array(self.orientation).normalize()
    }
}

impl HeadEyes {
    fn of(&self, eye: Eye) -> &HeadEye {
        if eye == Eye::LEFT { &self.left } else { &self.right }
    }

    /// Returns the rectified frame that both eyes share. Its x axis is the baseline, and its pitch makes the vertical
    /// field of view symmetric.
    ///
    /// # Errors
    /// A message, if an eye is invalid, the right eye is not to the right of the left one, or the eyes' fields of view
    /// diverge too far.
    pub fn rectified(&self) -> Result<Rectified, String> {
        if let Some((eye, fault)) = Eye::BOTH.iter().find_map(|eye| Some((eye, self.of(*eye).fault()?))) {
            return Err(format!("the {eye} eye: {fault}"));
        }
        let [left, right] = Eye::BOTH.map(|eye| DVec3::from(self.of(eye).position_m));
        let apart = right - left;
        let across = apart.try_normalize().unwrap_or(DVec3::X);
        if across.x < LEAST_COS_RIGHT {
            return Err("the right eye must be to the right of the left one".to_owned());
        }
        // The frame's x axis is the baseline; y and z have an arbitrary pitch around it.
        let ahead = (DVec3::NEG_Z - across * across.dot(DVec3::NEG_Z)).normalize();
        let around = DMat3::from_cols(across, across.cross(ahead), ahead);
        let corners = || Eye::BOTH.into_iter().flat_map(|eye| self.of(eye).corners().map(|c| around.transpose() * c));
        let elevations = corners().map(|c| c.y.atan2(c.z));
        let [low, high] =
            [elevations.clone().fold(f64::INFINITY, f64::min), elevations.fold(f64::NEG_INFINITY, f64::max)];
        let (turn, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let forward = ahead * turn.cos() + around.y_axis * turn.sin();
        let axes = DMat3::from_cols(across, across.cross(forward), forward);
        let widest = WIDEST_DEG.to_radians().tan();
        let seen = corners().map(|c| axes.transpose() * (around * c));
        let tan_x = seen.map(|c| if c.z > 0.0 { (c.x / c.z).abs() } else { f64::INFINITY }).fold(0.0, f64::max);
        if !(tan_x <= widest && half <= WIDEST_DEG.to_radians()) {
            return Err(format!(
                "the eyes see more than {WIDEST_DEG} degrees away from the forward direction that they share"
            ));
        }
        let lens = |eye| {
            let eye = self.of(eye);
            let turned = DMat3::from_quat(eye.orientation());
            let own = DMat3::from_cols(turned.x_axis, turned.y_axis, -turned.z_axis);
            let Fov { left, right, up, down } = eye.fov;
            let tan = Fov { left: left.tan(), right: right.tan(), up: up.tan(), down: down.tan() };
            Lens { axes: axes.transpose() * own, tan }
        };
        Ok(Rectified {
            optics: Optics { lenses: Eye::BOTH.map(lens), tan_half: [tan_x, half.tan()] },
            position_m: (left + right) / 2.0,
            orientation: DQuat::from_mat3(&DMat3::from_cols(axes.x_axis, axes.y_axis, -axes.z_axis)).normalize(),
            baseline_m: apart.length(),
        })
    }
}

impl HeadEye {
    /// Returns the directions through the corners of the eye's field of view, in the head's axes.
    fn corners(&self) -> [DVec3; 4] {
        let Fov { left, right, up, down } = self.fov;
        let turned = self.orientation();
        let corner = |(x, y): (f64, f64)| turned * DVec3::new(x.tan(), y.tan(), -1.0);
        [(left, up), (right, up), (left, down), (right, down)].map(corner)
    }
}

impl Lens {
    /// Returns the direction through a point of the eye's image, given in pixels from the top left of an image of
    /// `size`. The direction is in the rig's right, up and forward; its component along the eye's axis is 1.
    fn ray(&self, [x, y]: [f64; 2], size: Extent) -> DVec3 {
        let Fov { left, right, up, down } = self.tan;
        let across = left + (right - left) * x / f64::from(size.width);
        let upward = up + (down - up) * y / f64::from(size.height);
        self.axes * DVec3::new(across, upward, 1.0)
    }

    /// Returns the matrix that maps points (x, y, 1) to the directions [`Self::ray`].
    pub(super) fn rays(&self, size: Extent) -> DMat3 {
        let at = |x, y| self.ray([x, y], size);
        let corner = at(0.0, 0.0);
        DMat3::from_cols(at(1.0, 0.0) - corner, at(0.0, 1.0) - corner, corner)
    }

    /// Returns the distance in the rectified frame, as a tangent, that corresponds to a step of one pixel in the eye's
    /// image, minimised over the directions of the step. The step begins at the eye's axis if that is in the image,
    /// else at the middle of the image.
    fn least_step(&self, size: Extent) -> f64 {
        let Fov { left, right, up, down } = self.tan;
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let inside = |share: f64| if (0.0..=1.0).contains(&share) { share } else { 0.5 };
        let at = [inside(-left / (right - left)) * width, inside(up / (up - down)) * height];
        let seen = |at| {
            let ray = self.ray(at, size);
            DVec2::new(ray.x, ray.y) / ray.z
        };
        let step = 1e-4;
        let middle = seen(at);
        let across = (seen([at[0] + step, at[1]]) - middle) / step;
        let down = (seen([at[0], at[1] + step]) - middle) / step;
        // Smaller singular value of the Jacobian.
        let jacobian = DMat2::from_cols(across, down);
        let (squares, area) = (across.length_squared() + down.length_squared(), jacobian.determinant().abs());
        let spread = (squares * squares - 4.0 * area * area).max(0.0).sqrt();
        ((squares - spread) / 2.0).max(0.0).sqrt()
    }
}

/// Margin on each side of the rectified frame in pixels, for the filter of display resampling.
const MARGIN_PX: f64 = 2.0;
/// Maximum ratio of the rectified frame's pixel count to that of one eye.
const MOST_TIMES: f64 = 16.0;

impl Optics {
    /// Returns the size of the rectified frame for eye images of `size`. Its pixel density is `density` times that of
    /// the eyes, both horizontally and vertically, measured at their optical axes.
    ///
    /// # Errors
    /// A message, if the frame would have too many pixels.
    fn grid(&self, size: Extent, density: f64) -> Result<Extent, String> {
        let least_step = self.lenses.iter().map(|lens| lens.least_step(size)).fold(f64::INFINITY, f64::min);
        let pixels = self.tan_half.map(|tan| (2.0 * tan * density / least_step).ceil() + 2.0 * MARGIN_PX);
        let times = pixels[0] * pixels[1] / size.area() as f64;
        // The ratio is NaN if the step is 0.
        if times.is_nan() || times > MOST_TIMES {
            return Err(format!(
                "a frame that covers both eyes needs {times:.0} times the pixels of one eye (at most {MOST_TIMES})"
            ));
        }
        Ok(Extent::new(pixels[0] as u32, pixels[1] as u32))
    }

    /// Returns the size of the rectified frame for eye images of `size`, with 1.25 times their pixel density.
    ///
    /// # Errors
    /// A message, if the frame would have too many pixels.
    pub fn rectified(&self, size: Extent) -> Result<Extent, String> {
        /// Ratio of the rectified frame's pixel density to the eyes', horizontally and vertically.
        const DENSITY: f64 = 1.25;
        self.grid(size, DENSITY)
    }

    /// Returns tangents of half the field of view of the rendered frame, margin included.
    pub fn rendered_tan_half(&self, grid: Extent) -> [f64; 2] {
        let sides = [grid.width, grid.height].map(f64::from);
        [0, 1].map(|i| self.tan_half[i] * sides[i] / (sides[i] - 2.0 * MARGIN_PX).max(1.0))
    }

    /// Returns true if the eyes' images of this size match the rectified frame to a fraction of a pixel: both eyes look
    /// the same way and see the whole frame, with square pixels.
    pub fn is_plain(&self, size: Extent) -> bool {
        let [x, y] = self.tan_half;
        let (width, height) = (f64::from(size.width), f64::from(size.height));
        let slack = [x / width, y / height].map(|pixel| 0.1 * pixel);
        let sees_all = |Lens { axes, tan: Fov { left, right, up, down } }: &Lens| {
            let off = [(left + x, 0), (right - x, 0), (up - y, 1), (down + y, 1)];
            axes.abs_diff_eq(DMat3::IDENTITY, slack[0].min(slack[1]))
                && off.iter().all(|(off, axis)| off.abs() < slack[*axis])
        };
        let is_square = (x * height - y * width).abs() < slack[0] * height;
        is_square && self.lenses.iter().all(sees_all)
    }

    /// Adds `border_deg` degrees of overscan on all sides, up to the largest planar field of view.
    pub fn widened(self, border_deg: f64) -> Self {
        let wider = |tan: f64| (tan.atan() + border_deg.to_radians()).min(WIDEST_DEG.to_radians()).tan().max(tan);
        Self { tan_half: self.tan_half.map(wider), ..self }
    }

    /// Returns the homography from points (x, y, 1) of an eye's image of `size` pixels to homogeneous pixels (x, y, z)
    /// of its rectified image, both from the top left. The pixel is (x / z, y / z). z is the depth, along the rig's
    /// forward vector, of the point at depth 1 along the eye's axis.
    pub fn homography(&self, eye: Eye, size: Extent, grid: Extent) -> DMat3 {
        self.rectified_points(grid) * self.lenses[eye.index()].rays(size)
    }

    /// Maps a point of an eye's image to the rectified image, both in pixels from the top left. Also returns the scale
    /// there, in rectified pixels per pixel of the eye along an axis: the square root of the ratio of areas.
    pub fn rectified_point(&self, eye: Eye, [size, grid]: [Extent; 2], [x, y]: [f64; 2]) -> ([f64; 2], f64) {
        let columns = self.homography(eye, size, grid);
        let seen = columns * DVec3::new(x, y, 1.0);
        let point = DVec2::new(seen.x, seen.y) / seen.z;
        let step = |column: DVec3| (DVec2::new(column.x, column.y) - point * column.z) / seen.z;
        let jacobian = DMat2::from_cols(step(columns.x_axis), step(columns.y_axis));
        (point.to_array(), jacobian.determinant().abs().sqrt())
    }

    /// Returns the projection from points relative to an eye, in its rig's right, up and forward, to homogeneous pixels
    /// of the rectified image. z is the depth along forward.
    pub fn rectified_points(&self, grid: Extent) -> DMat3 {
        let [tan_x, tan_y] = self.rendered_tan_half(grid);
        let (x, y) = (f64::from(grid.width) / 2.0, f64::from(grid.height) / 2.0);
        DMat3::from_cols(DVec3::new(x / tan_x, 0.0, 0.0), DVec3::new(0.0, -y / tan_y, 0.0), DVec3::new(x, y, 1.0))
    }
}

#[cfg(test)]
mod tests;
