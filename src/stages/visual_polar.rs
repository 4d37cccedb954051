//! Visual-polar images: rows are rings around the gaze, columns are directions from it, and each ring has as many of the
//! rows as visual acuity asks for there (Koskela et al. 2019, "Foveated Real-Time Path Tracing in Visual-Polar Space").
//!
//! An eye's image has `rows` rings. The innermost `fovea_rows` are those of the fovea, where rings are equally wide and
//! have the fewer columns the smaller they are. Outside it the number of rings up to an eccentricity grows as the acuity
//! summed up to there does. Departures from the paper: rings are rows rather than columns, so that a stripe's neighbours
//! are those of any image, and where the gaze leaves the middle, rings get wider but their pixels stay as many.

use std::f64::consts::PI;

use glam::Vec3;

use super::layout::View;
use crate::image::Extent;
use crate::scene::shot::Gaze;

/// Where acuity begins to fall, degrees from the gaze.
pub const FOVEA_DEG: f64 = 5.79;
/// Square degrees that the fovea covers.
const FOVEA_AREA: f64 = PI * FOVEA_DEG * FOVEA_DEG;
/// What acuity sums up to over a disc is a multiple of this, square degrees.
const ACUITY_SUM: f64 = 166.4 * PI;

/// Images that are traced and filtered around the gaze, which may move with every frame.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualPolar {
    /// Of the left and the right eye.
    pub gaze: [Gaze; 2],
}

/// The sum of relative acuity over the disc within `degrees`, at least those of the fovea, square degrees.
fn acuity_within(degrees: f64) -> f64 {
    let part = |degrees: f64| {
        let falling = 0.3 * degrees + 1.0;
        1.0 / falling + falling.ln()
    };
    FOVEA_AREA + ACUITY_SUM * (part(degrees) - part(FOVEA_DEG))
}

/// The share of rings that the fovea has where the outermost is at `degrees`: density is continuous at its rim.
fn fovea_share(degrees: f64) -> f64 {
    2.0 * FOVEA_AREA / (FOVEA_AREA + acuity_within(degrees))
}

/// The eccentricity of the corner that is farthest from the gaze, degrees.
fn farthest_corner(view: &View, gaze: Vec3) -> f64 {
    let corner = |x: f32, y: f32| view.forward + view.right * (x * view.tan_half_x) + view.up * (y * view.tan_half_y);
    let corners = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, -1.0), corner(1.0, 1.0)];
    corners.map(|c| f64::from(gaze.angle_between(c)).to_degrees()).into_iter().fold(0.0, f64::max)
}

impl VisualPolar {
    /// Columns and rows of the images for a screen of this size.
    pub fn grid(screen: Extent) -> Extent {
        let of = |pixels: u32| (2 * pixels).div_ceil(3).max(1);
        Extent::new(of(screen.width), of(screen.height))
    }

    /// An eye's view with its gaze at `time_s`, on a grid of so many rows.
    pub(crate) fn look(&self, eye: usize, time_s: f64, view: View, rows: u32) -> View {
        let [x, y] = self.gaze[eye].at(time_s);
        let (across, up) = (2.0 * x as f32 - 1.0, 1.0 - 2.0 * y as f32);
        let at = view.forward + view.right * (across * view.tan_half_x) + view.up * (up * view.tan_half_y);
        let gaze = at.normalize();
        let share = fovea_share(farthest_corner(&view, gaze));
        // As many pixels as where the gaze is in the middle, which leaves a share of rings / 2 out in the fovea.
        let centred = fovea_share(farthest_corner(&view, view.forward));
        let rows = (f64::from(rows) * (1.0 - 0.5 * centred) / (1.0 - 0.5 * share)).round().max(1.0);
        View {
            gaze,
            gaze_right: (view.right - gaze * gaze.dot(view.right)).normalize(),
            rows: rows as f32,
            fovea_rows: (rows * share) as f32,
            ..view
        }
    }
}

/// The pixels of an eye's image that are there.
pub(super) fn pixels(view: &View, columns: u32) -> u64 {
    (0..view.rows as u32).map(|row| u64::from(row_length(view, columns, row))).sum()
}

/// Columns of a ring, in images of so many columns; as shaders have it.
fn row_length(view: &View, columns: u32, row: u32) -> u32 {
    let length = (columns as f32 * (row as f32 + 0.5) / view.fovea_rows).ceil();
    length.clamp(1.0, columns as f32) as u32
}
