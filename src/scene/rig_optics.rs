//! Optics that follow from rigs.

use glam::{DMat3, DVec3};

use super::eye::Eye;
use super::optics::{Fov, Lens, Optics};
use super::rig::Rig;
use crate::image::Extent;

impl Optics {
    /// Of a rig without optics, whose images have this size: they are rendered with so many degrees more on all sides, which
    /// are there to be shown when the head turns.
    pub fn with_border(rig: &Rig, size: Extent, border_deg: f64) -> Self {
        let tan_y = (rig.yfov_rad / 2.0).tan();
        let tan = [tan_y * f64::from(size.width) / f64::from(size.height), tan_y];
        let lens = Lens { axes: DMat3::IDENTITY, tan: Fov { left: -tan[0], right: tan[0], up: tan[1], down: -tan[1] } };
        Self { lenses: [lens; 2], tan_half: tan }.widened(border_deg)
    }

    /// The same from what the eye shows when the rig has moved on from `rendered` to `later`, each of one key; and where the
    /// later eye itself is, times its distance: a point that is t away along the later eye's axis is t times the first plus
    /// the second.
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
        (points * turned * self.lenses[eye as usize].rays(size), points * (rendered_from_world * (to - from)))
    }
}
