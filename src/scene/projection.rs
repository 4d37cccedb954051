//! World-to-camera and world-to-image matrices of an eye's image, which are stored in files.

use glam::{DMat3, DVec4};
use serde::Serialize;

use super::optics::Fov;
use super::rig::{Eye, Rig};
use crate::image::Extent;

/// Matrices in the conventions of OpenEXR's attributes of these names: each is a list of four rows of a matrix M that
/// transforms row vectors, (x, y, z, 1) · M.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Matrices {
    /// World to eye, in scene units: x to the right, y up, z along the view.
    pub world_to_camera: [[f32; 4]; 4],
    /// World to image: after division by w, (0, 0) is its top left corner and (1, 1) its bottom right one; z is one
    /// over the depth along the camera's axis.
    pub world_to_ndc: [[f32; 4]; 4],
}

impl Rig {
    /// Returns the matrices of an eye's image of this size at `time_s`.
    pub fn matrices(&self, time_s: f64, eye: Eye, extent: Extent) -> Matrices {
        let (origin, axes) = self.pose(time_s, eye);
        let tan_y = (self.yfov_rad / 2.0).tan();
        let tan_x = tan_y * f64::from(extent.width) / f64::from(extent.height);
        let (turned, Fov { left, right, up, down }) = match &self.optics {
            None => {
                let shift = self.shift_x(eye);
                (DMat3::IDENTITY, Fov { left: shift - tan_x, right: shift + tan_x, up: tan_y, down: -tan_y })
            }
            Some(optics) => (optics.lenses[eye.index()].axes, optics.lenses[eye.index()].tan),
        };
        let own = DMat3::from_cols_array_2d(&axes.map(Into::into)) * turned;
        let [x, y, z] = [own.x_axis, own.y_axis, own.z_axis].map(|axis| axis.extend(-axis.dot(origin)));
        let across = (x - z * left) / (right - left);
        let down = (z * up - y) / (up - down);
        Matrices {
            world_to_camera: from_columns([x, y, z, DVec4::W]),
            world_to_ndc: from_columns([across, down, DVec4::W, z]),
        }
    }

    /// Returns the distance of neighbouring views in scene units.
    pub fn baseline_units(&self) -> f64 {
        self.baseline_m / self.metres_per_unit
    }
}

fn from_columns(columns: [DVec4; 4]) -> [[f32; 4]; 4] {
    std::array::from_fn(|row| columns.map(|column| column[row] as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::rig::RigKey;
    use glam::DVec3;

    fn rig() -> Rig {
        let key = |time_s, position: [f64; 3], target: [f64; 3]| RigKey {
            time_s,
            position: position.into(),
            target: target.into(),
            up: DVec3::Y,
        };
        let keys = vec![key(0.0, [1.0, 1.6, 2.5], [0.0, 1.2, -3.0]), key(2.0, [0.6, 1.6, 1.2], [-1.0, 1.1, -3.0])];
        Rig { yfov_rad: 40f64.to_radians(), baseline_m: 0.064, metres_per_unit: 0.01, ..Rig::of_keys(keys) }
    }

    fn times(point: DVec3, matrix: [[f32; 4]; 4]) -> [f64; 4] {
        let row = [point.x, point.y, point.z, 1.0];
        std::array::from_fn(|c| (0..4).map(|r| row[r] * f64::from(matrix[r][c])).sum())
    }

    /// Rays are computed independently, from an eye's axes.
    #[test]
    fn matrices_project_ray_points_to_their_pixel() {
        let (rig, extent) = (rig(), Extent::new(64, 36));
        for eye in Eye::BOTH {
            let view = rig.view(0.7, eye);
            let matrices = rig.matrices(0.7, eye, extent);
            for (x, y, distance) in [(0.0, 0.0, 3.0), (64.0, 36.0, 0.5), (10.25, 30.5, 80.0), (32.0, 18.0, 1.0)] {
                let point = view.origin.as_dvec3() + view.ray_direction(x, y, extent) * distance;
                let [u, v, near, w] = times(point, matrices.world_to_ndc);
                assert!((u / w * 64.0 - x).abs() < 1e-3 && (v / w * 36.0 - y).abs() < 1e-3, "{u} {v} {w}");
                let [right, up, ahead, one] = times(point, matrices.world_to_camera);
                assert!((ahead - w).abs() < 1e-4 && (near / w * ahead - 1.0).abs() < 1e-4 && one == 1.0);
                assert!((right.hypot(up).hypot(ahead) - distance).abs() < 1e-4 * distance.max(1.0));
                assert!((right > 0.0) == (x > 32.0) && (up > 0.0) == (y < 18.0) || x == 32.0, "{right} {up}");
            }
        }
        assert_eq!(rig.baseline_units(), 6.4);
    }
}
