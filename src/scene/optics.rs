//! Eyes that see less on one side than on the other, and may be turned apart (canted), as those of headsets are.
//!
//! Reprojection needs both eyes on the same rows, so what is rendered of such eyes is a rectified frame: images of the same
//! orientation, whose right vector leads from eye to eye, and of the same symmetric field of view, which covers that of
//! either eye (Fusiello, Trucco & Verri 2000, "A compact algorithm for rectification of stereo pairs"). As an eye sees
//! both from the same point, what it shows is a homography of its rectified image.

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::eye::Eye;
use crate::image::Extent;

/// The angles at which a field of view ends, radians from the eye's axis, to the right and upwards above 0: those of
/// OpenXR's `XrFovf`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fov {
    pub left: f64,
    pub right: f64,
    pub up: f64,
    pub down: f64,
}

/// Where an eye is in its head, and what it sees. The head's axes are x to the right, y up and −z ahead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadEye {
    pub position_m: [f64; 3],
    /// A unit quaternion (x, y, z, w) that turns from the eye's axes to the head's.
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

/// What an eye shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// The eye's right, up and forward vectors as columns, in those of its rig.
    pub axes: DMat3,
    /// Tangents of its field of view.
    pub tan: Fov,
}

/// The eyes of a rig that shows other images than it renders.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Optics {
    pub lenses: [Lens; 2],
    /// Tangents of half the rectified frame's field of view, across and up.
    pub tan_half: [f64; 2],
}

/// Eyes in the rectified frame that they share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectified {
    pub optics: Optics,
    /// Of the rig: between the eyes, in the head, metres.
    pub position_m: DVec3,
    /// From the rig's axes, with −z ahead, to the head's.
    pub orientation: DQuat,
    pub baseline_m: f64,
}

/// The widest a rectified frame gets to either side: images of a plane grow without bounds towards 90 degrees.
const WIDEST_DEG: f64 = 80.0;
/// The least cosine between the way from eye to eye and the head's right.
const LEAST_COS_RIGHT: f64 = 0.5;

impl HeadEye {
    /// What is wrong with it, if anything is.
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
        match eye {
            Eye::Left => &self.left,
            Eye::Right => &self.right,
        }
    }

    /// The frame that both share: as upright as the eyes are, and turned up or down so far that it reaches as far both ways.
    ///
    /// # Errors
    /// A sentence, if an eye is none or both see too far apart.
    pub fn rectified(&self) -> Result<Rectified, String> {
        if let Some((eye, fault)) = Eye::ALL.iter().find_map(|eye| Some((eye, self.of(*eye).fault()?))) {
            return Err(format!("the {eye} eye: {fault}"));
        }
        let [left, right] = Eye::ALL.map(|eye| DVec3::from(self.of(eye).position_m));
        let apart = right - left;
        let across = apart.try_normalize().unwrap_or(DVec3::X);
        if across.x < LEAST_COS_RIGHT {
            return Err("the right eye must be to the right of the left one".to_owned());
        }
        // With y and z around the way from eye to eye, in whatever turn.
        let ahead = (DVec3::NEG_Z - across * across.dot(DVec3::NEG_Z)).normalize();
        let around = DMat3::from_cols(across, across.cross(ahead), ahead);
        let corners = || Eye::ALL.into_iter().flat_map(|eye| self.of(eye).corners().map(|c| around.transpose() * c));
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
                "the eyes see further apart than {WIDEST_DEG} degrees from a direction that they share"
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
            optics: Optics { lenses: Eye::ALL.map(lens), tan_half: [tan_x, half.tan()] },
            position_m: (left + right) / 2.0,
            orientation: DQuat::from_mat3(&DMat3::from_cols(axes.x_axis, axes.y_axis, -axes.z_axis)).normalize(),
            baseline_m: apart.length(),
        })
    }
}

impl HeadEye {
    /// Directions through the corners of what it sees, in the head.
    fn corners(&self) -> [DVec3; 4] {
        let Fov { left, right, up, down } = self.fov;
        let turned = self.orientation();
        let corner = |(x, y): (f64, f64)| turned * DVec3::new(x.tan(), y.tan(), -1.0);
        [(left, up), (right, up), (left, down), (right, down)].map(corner)
    }
}

impl Lens {
    /// The direction through a point of the eye's image of this size, in the rig's right, up and forward: 1 along its axis.
    fn ray(&self, [x, y]: [f64; 2], size: Extent) -> DVec3 {
        let Fov { left, right, up, down } = self.tan;
        let across = left + (right - left) * x / f64::from(size.width);
        let upward = up + (down - up) * y / f64::from(size.height);
        self.axes * DVec3::new(across, upward, 1.0)
    }

    /// The directions [`Self::ray`] of points (x, y, 1).
    pub(super) fn rays(&self, size: Extent) -> DMat3 {
        let at = |x, y| self.ray([x, y], size);
        let corner = at(0.0, 0.0);
        DMat3::from_cols(at(1.0, 0.0) - corner, at(0.0, 1.0) - corner, corner)
    }

    /// The least that a step of one pixel of the eye's image, in whatever direction, takes along the tangents of the
    /// rectified frame where the eye looks straight ahead, or if it does not see that, in the middle of its image.
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
        // The smaller singular value.
        let jacobian = DMat2::from_cols(across, down);
        let (squares, area) = (across.length_squared() + down.length_squared(), jacobian.determinant().abs());
        let spread = (squares * squares - 4.0 * area * area).max(0.0).sqrt();
        ((squares - spread) / 2.0).max(0.0).sqrt()
    }
}

/// Pixels around the rectified frame beside those that are shown, which resampling reads.
const MARGIN_PX: f64 = 2.0;
/// The most pixels of the rectified frame over those that are shown.
const MOST_TIMES: f64 = 16.0;

impl Optics {
    /// The pixels of the rectified frame of eyes that show images of this size: `density` times as many along each axis as
    /// the eyes have where they look straight ahead.
    ///
    /// # Errors
    /// A sentence, if those would be too many.
    pub fn grid(&self, size: Extent, density: f64) -> Result<Extent, String> {
        let least_step = self.lenses.iter().map(|lens| lens.least_step(size)).fold(f64::INFINITY, f64::min);
        let pixels = self.tan_half.map(|tan| (2.0 * tan * density / least_step).ceil() + 2.0 * MARGIN_PX);
        let times = pixels[0] * pixels[1] / size.area() as f64;
        // No number, where the step is none.
        if times.is_nan() || times > MOST_TIMES {
            return Err(format!(
                "what covers both eyes, with its border, takes {times:.0} times the pixels that they show (at most {MOST_TIMES})"
            ));
        }
        Ok(Extent::new(pixels[0] as u32, pixels[1] as u32))
    }

    /// Returns the size of the rectified frame of eyes that show images of this size, at 1.25 times their density.
    ///
    /// # Errors
    /// Those of [`Self::grid`].
    pub fn rectified(&self, size: Extent) -> Result<Extent, String> {
        /// Pixels of the rectified frame over those of the eyes, along each axis, where these look straight ahead.
        const DENSITY: f64 = 1.25;
        self.grid(size, DENSITY)
    }

    /// Tangents of half the field of view of the frame that is rendered, its margin included.
    pub fn rendered_tan_half(&self, grid: Extent) -> [f64; 2] {
        let sides = [grid.width, grid.height].map(f64::from);
        [0, 1].map(|i| self.tan_half[i] * sides[i] / (sides[i] - 2.0 * MARGIN_PX).max(1.0))
    }

    /// Whether what eyes show in images of this size is what is rendered for such a size, to a part of a pixel: both look the same
    /// way and see all of a frame with square pixels.
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

    /// With so many degrees more on all sides, as far as a plane holds them.
    pub fn widened(self, border_deg: f64) -> Self {
        let wider = |tan: f64| (tan.atan() + border_deg.to_radians()).min(WIDEST_DEG.to_radians()).tan().max(tan);
        Self { tan_half: self.tan_half.map(wider), ..self }
    }

    /// From a point (x, y, 1) of the image of `size` pixels that an eye shows to the point (x, y) / z of its rectified image,
    /// in pixels from the top left; z is the distance along the rig's forward of what is 1 away along the eye's.
    pub fn homography(&self, eye: Eye, size: Extent, grid: Extent) -> DMat3 {
        self.rectified_points(grid) * self.lenses[eye as usize].rays(size)
    }

    /// Where the rectified image has a point of the image of an eye, both in pixels from the top left, and how many pixels it
    /// has there for one of the eye's, along an axis: the root of how many for its area.
    pub fn rectified_point(&self, eye: Eye, [size, grid]: [Extent; 2], [x, y]: [f64; 2]) -> ([f64; 2], f64) {
        let columns = self.homography(eye, size, grid);
        let seen = columns * DVec3::new(x, y, 1.0);
        let point = DVec2::new(seen.x, seen.y) / seen.z;
        let step = |column: DVec3| (DVec2::new(column.x, column.y) - point * column.z) / seen.z;
        let jacobian = DMat2::from_cols(step(columns.x_axis), step(columns.y_axis));
        (point.to_array(), jacobian.determinant().abs().sqrt())
    }

    /// From a point relative to an eye, in its rig's right, up and forward, to its place in the rectified image, times its
    /// distance along forward.
    pub fn rectified_points(&self, grid: Extent) -> DMat3 {
        let [tan_x, tan_y] = self.rendered_tan_half(grid);
        let (x, y) = (f64::from(grid.width) / 2.0, f64::from(grid.height) / 2.0);
        DMat3::from_cols(DVec3::new(x / tan_x, 0.0, 0.0), DVec3::new(0.0, -y / tan_y, 0.0), DVec3::new(x, y, 1.0))
    }
}

#[cfg(test)]
mod tests;
