//! Optics derived from rigs.

use glam::{DMat3, DVec3};

use super::eye::Eye;
use super::optics::{Fov, Lens, Optics};
use super::rig::Rig;
use crate::image::Extent;

impl Optics {
    /// Returns optics for a rig that has none, for images of this size. Compared with the rig's own field of view, the
    /// rendered frame has `border_deg` degrees of overscan on all sides, for late reprojection when the head turns.
    pub fn with_border(rig: &Rig, size: Extent, border_deg: f64) -> Self {
        let tan_y = (rig.yfov_rad / 2.0).tan();
        let tan = [tan_y * f64::from(size.width) / f64::from(size.height), tan_y];
        let lens = Lens { axes: DMat3::IDENTITY, tan: Fov { left: -tan[0], right: tan[0], up: tan[1], down: -tan[1] } };
        Self { lenses: [lens; 2], tan_half: tan }.widened(border_deg)
    }

    /// Returns the homography and the translation for late reprojection from the rig `rendered` to `later`, each with
    /// one key. A point at depth t along the later eye's axis maps to homogeneous pixels of the rectified image: t
    /// times the homography of its pixel, plus the translation.
    pub fn later_homography(
        &self,
        eye: Eye,
        [size, grid]: [Extent; 2],
        [rendered, later]: [&Rig; 2],
    ) -> (DMat3, DVec3) {
        let [(from, before), (to, now)] = [rendered, later].map(|rig| rig.pose(0.0, eye));
        let rendered_from_world = DMat3::from_cols(before[0], before[1], before[2]).transpose();
        let turned = rendered_from_world * DMat3::from_cols(now[0], now[1], now[2]);
        let points = self.rectified_points(grid);
        (points * turned * self.lenses[eye.index()].rays(size), points * (rendered_from_world * (to - from)))
    }
}
