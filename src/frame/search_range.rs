//! Search range of temporal reprojection: the rows of the previous frame that may hold the history of a row.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec3};

use crate::accel::Moved;
use crate::layout::{Camera, View};
use crate::projection::{PolarSpace, Project};
use crate::tables::SceneTables;

/// Granularity of the search range, rows. It lets successive frames reuse a frame graph while the camera moves.
const STEP_ROWS: u32 = 4;
/// The search range in perspective images is at most the height of the image divided by this number. Surfaces that
/// moved further have no history.
const LARGEST_SHARE: u32 = 4;

/// Returns the search range: the maximum number of rows, up or down, by which a surface moved in the image since the
/// previous frame. In perspective images it is at most a quarter of the height, and nearby surfaces that moved further
/// have no history. Returns `None` if the eyes turned so far that hardly any surface is seen again.
///
/// `polar` is the projection of the image, if it is polar. For the right eye, the left eye's history of nearby surfaces
/// may then lie outside the search range.
///
/// `moved` holds each body's motion since the previous frame.
///
/// The search range affects the rendered images. It depends only on scene and cameras, so any set of devices renders
/// the same images.
pub fn history_rows(
    polar: Option<PolarSpace>,
    camera: &Camera,
    previous: &[View; 2],
    tables: &SceneTables,
    moved: &[Moved],
) -> Option<u32> {
    if let Some(space) = polar {
        return Some(polar_rows(space.method(), camera, previous, tables, moved));
    }
    let far = most_rows(camera, previous, [0.0; 2])?;
    let largest = (camera.height / LARGEST_SHARE).max(STEP_ROWS);
    if far > f64::from(largest) {
        return None;
    }
    let nearest = camera.views.each_ref().map(|v| 1.0 / f64::from(tables.clearance(v.origin)));
    let near = most_rows(camera, previous, nearest).unwrap_or(f64::INFINITY);
    let own = camera.views.each_ref().map(|eye| rows_of_bodies(camera, eye, moved));
    let rows = (far.max(near) + own[0].max(own[1])).min(f64::from(largest)) as u32;
    Some(rows.next_multiple_of(STEP_ROWS).min(largest))
}

/// Returns the search range in polar images, where a saccade moves surfaces by many rows.
fn polar_rows(
    projection: &dyn Project,
    camera: &Camera,
    previous: &[View; 2],
    tables: &SceneTables,
    moved: &[Moved],
) -> u32 {
    let sine_of = |sine: f64| if sine < 1.0 { sine.asin() } else { PI };
    let rows = [0, 1].map(|eye| {
        let (now, last) = (&camera.views[eye], &previous[eye]);
        let step = f64::from(now.origin.distance(last.origin));
        let stepped = sine_of(step / f64::from(tables.clearance(now.origin)));
        projection.rows_moved(now, last, stepped + angle_of_bodies(now, moved).min(PI))
    });
    let rows = (rows[0].max(rows[1]) + 0.02).ceil().min(f64::from(camera.height)) as u32;
    rows.next_multiple_of(STEP_ROWS).min(camera.height)
}

/// Returns the maximum angle, in radians, by which the motion of bodies shifts surfaces and their images in mirrors, seen
/// from an eye; infinite if there is no bound.
fn angle_of_bodies(eye: &View, moved: &[Moved]) -> f64 {
    let angle = |body: &Moved, by: f32| {
        let (low, high) = (Vec3::from(body.bounds.min).as_dvec3(), Vec3::from(body.bounds.max).as_dvec3());
        let (origin, by) = (eye.origin.as_dvec3(), f64::from(by));
        let distance = origin.distance(origin.clamp(low, high));
        let sine = by / (distance - by);
        match by > 0.0 {
            true if distance > by && sine < 1.0 => sine.asin(),
            true => f64::INFINITY,
            false => 0.0,
        }
    };
    // No image in a mirror is nearer than the mirror or than the surface. A mirror that moves or turns shifts images by
    // twice as much.
    let in_mirrors =
        moved.iter().filter_map(|body| Some(angle(body, 2.0 * body.by) + 2.0 * f64::from(body.mirrors_turned?)));
    moved.iter().map(|body| angle(body, body.by)).fold(0.0, f64::max) + in_mirrors.fold(0.0, f64::max)
}

/// Returns the maximum number of rows by which the motion of bodies shifts surfaces in an eye's image.
fn rows_of_bodies(camera: &Camera, eye: &View, moved: &[Moved]) -> f64 {
    let angle = angle_of_bodies(eye, moved);
    // An angle spans the most rows at the corners of the image.
    let stretch =
        1.0 + (f64::from(eye.tan_half_x) + f64::from(eye.shift_x.abs())).powi(2) + f64::from(eye.tan_half_y).powi(2);
    let per_radian = 0.5 * f64::from(camera.height) / f64::from(eye.tan_half_y);
    (angle * stretch * per_radian).ceil()
}

/// Returns the maximum number of rows between the current and the previous image position of static points.
/// `nearness` holds, for each eye, the inverse of the points' distance from it, 1 / scene units; 0 for points at
/// infinity. Returns `None` if some of the points may have been behind an eye in the previous frame.
///
/// The previous position is a quotient of two functions that are linear in the column and in the inverse depth. So its
/// extremes lie at the outermost columns, and at infinity or the smallest depth.
fn most_rows(camera: &Camera, previous: &[View; 2], nearness: [f64; 2]) -> Option<f64> {
    let mut most: f64 = 0.0;
    let centre = camera.centre.as_dvec2();
    for (now, before) in [(0, 0), (1, 1), (1, 0)] {
        let (eye, last) = (&camera.views[now], &previous[before]);
        // Depth is at least the distance times the cosine at the corners.
        let corner =
            (f64::from(eye.tan_half_x) + f64::from(eye.shift_x.abs())).hypot(f64::from(eye.tan_half_y)).hypot(1.0);
        let inverse_depth = nearness[now] * corner;
        for row in 0..camera.height {
            for column in [0, camera.width - 1] {
                let at = centre + DVec2::new(f64::from(column), f64::from(row));
                most = most.max((seen_row(camera, eye, last, at, inverse_depth)? - at.y).abs());
            }
        }
    }
    // Add a margin for rounding errors of shaders.
    Some((most + 0.02).ceil())
}

fn seen_row(camera: &Camera, eye: &View, last: &View, at: DVec2, inverse_depth: f64) -> Option<f64> {
    let axis = |v: Vec3| v.as_dvec3();
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let x = (2.0 * at.x / width - 1.0) * f64::from(eye.tan_half_x) + f64::from(eye.shift_x);
    let y = (1.0 - 2.0 * at.y / height) * f64::from(eye.tan_half_y);
    let ray: DVec3 = axis(eye.forward) + axis(eye.right) * x + axis(eye.up) * y;
    let p = (axis(eye.origin) - axis(last.origin)) * inverse_depth + ray;
    let z = p.dot(axis(last.forward));
    let up = p.dot(axis(last.up)) / (z * f64::from(last.tan_half_y));
    (z > 1e-3 && up.is_finite()).then_some((0.5 - 0.5 * up) * height)
}

#[cfg(test)]
mod tests;
