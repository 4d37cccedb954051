//! Display resampling by definition, in f64.

use diptych::layout;
use glam::{DMat3, DVec2, DVec3, Vec3, Vec3Swizzles};

use crate::kernels::camera::Eye;
use crate::kernels::inputs::Cases;

/// Maximum and minimum number of pixels of the rectified image that a display pixel covers along an axis.
const WIDTHS: [f64; 2] = [0.1, 8.0];
/// Iterations of the search for the surface that a later eye sees.
const ROUNDS: u32 = 8;

/// Map from an eye's display image to its rectified one of `size` pixels.
#[derive(Clone, Copy)]
pub struct Shown {
    pub from_shown: DMat3,
    /// Position of the displaying eye, times its distance.
    pub moved: DVec3,
    pub size: DVec2,
}

/// Place of a display pixel in the rectified image.
pub struct Place {
    pub point: DVec2,
    /// Size of the rectangle that it covers.
    pub widths: DVec2,
}

fn projected(seen: DVec3) -> DVec2 {
    seen.xy() / seen.z
}

/// Returns a place with a pixel's footprint by central differences.
fn place(at: DVec2, map: impl Fn(DVec2) -> DVec2) -> Place {
    const STEP: f64 = 1e-5;
    let along = |axis: DVec2| (map(at + axis * STEP) - map(at - axis * STEP)) / (2.0 * STEP);
    let (across, down) = (along(DVec2::X), along(DVec2::Y));
    let widths = (across * across + down * down).map(f64::sqrt);
    Place { point: map(at), widths: widths.clamp(DVec2::splat(WIDTHS[0]), DVec2::splat(WIDTHS[1])) }
}

impl Shown {
    /// Returns the map with numbers that are exact as floats, and its form on devices.
    pub fn rounded(self) -> (Self, layout::DisplayMap) {
        let [across, down, corner, moved] =
            [self.from_shown.x_axis, self.from_shown.y_axis, self.from_shown.z_axis, self.moved].map(|v| v.as_vec3());
        let [x, y, z] = [across, down, corner].map(Vec3::as_dvec3);
        let exact = Self { from_shown: DMat3::from_cols(x, y, z), moved: moved.as_dvec3(), ..self };
        (exact, layout::DisplayMap { across, down, corner, moved, ..Default::default() })
    }

    fn seen(&self, at: DVec2) -> DVec3 {
        self.from_shown * at.extend(1.0)
    }

    pub fn place(&self, at: DVec2) -> Place {
        place(at, |at| projected(self.seen(at)))
    }

    /// Returns the display image's point for a point of the rectified one.
    pub fn shown_point(&self, point: DVec2) -> DVec2 {
        projected(self.from_shown.inverse() * point.extend(1.0))
    }

    /// Returns column and row of the pixel nearest to a point; none if rounding decides.
    pub fn nearest(&self, point: DVec2) -> Option<[usize; 2]> {
        let last = self.size - 1.0;
        let is_clear = |at: f64, last: f64| at < -0.5 || at > last + 1.5 || (at - at.round()).abs() > 2e-4;
        let held = point.floor().clamp(DVec2::ZERO, last);
        (is_clear(point.x, last.x) && is_clear(point.y, last.y)).then_some([held.x as usize, held.y as usize])
    }

    /// Returns the place that a later eye sees. Fixed-point iteration finds it among the surfaces, which are at `depth`
    /// along the axis of the eye that rendered them. None if rounding decides.
    pub fn later_place(&self, at: DVec2, depth: impl Fn([usize; 2]) -> f64, cases: &mut Cases) -> Option<Place> {
        let far = self.place(at);
        if self.moved == DVec3::ZERO {
            cases.meet("where it was");
            return Some(far);
        }
        let mut distance = f64::INFINITY;
        let mut point = far.point;
        for _ in 0..ROUNDS {
            let depth = depth(self.nearest(point)?);
            distance = (depth - self.moved.z) / self.seen(at).z;
            if depth <= 0.0 || distance <= 0.0 {
                cases.meet(if depth <= 0.0 { "sky" } else { "behind the eye" });
                return Some(far);
            }
            point = projected(self.seen(at) * distance + self.moved);
        }
        cases.meet("moved");
        Some(place(at, |at| projected(self.seen(at) * distance + self.moved)))
    }
}

/// Returns the depth of a pixel's surface along the axis of the eye, for a distance along its ray.
pub fn depth(eye: &Eye, distance: f64, through: DVec2, size: DVec2) -> f64 {
    distance * eye.ray(through, size).dot(eye.forward.as_dvec3())
}

/// Integrates light from `low` to `high` over the middle one of five pixels with these means. The profile is a step
/// between uniform sides (Harten 1989), or a parabola that does not overshoot (Colella & Woodward 1984, equations 1.5
/// to 1.10).
fn part([two_before, before, own, after, two_after]: [f64; 5], [low, high]: [f64; 2], cases: &mut Cases) -> f64 {
    let rise = after - before;
    let rises = (after - own) * (own - before) > 0.0;
    if rises && (before - two_before).abs().max((two_after - after).abs()) < 0.25 * rise.abs() {
        cases.meet("edge");
        let step = (after - own) / rise;
        return before * (step.min(high) - low).max(0.0) + after * (high - step.max(low)).max(0.0);
    }
    let between = |a: f64, b: f64, c: f64, d: f64| ((7.0 * (b + c) - (a + d)) / 12.0).clamp(b.min(c), b.max(c));
    let begin = between(two_before, before, own, after);
    let end = between(before, own, after, two_after);
    let (off, most) = (own - 0.5 * (begin + end), (end - begin).abs() / 6.0);
    let (left, right) = if (end - own) * (own - begin) <= 0.0 {
        cases.meet("extreme");
        (own, own)
    } else if off.abs() <= most {
        cases.meet("parabola");
        (begin, end)
    } else if (off > 0.0) == (end > begin) {
        cases.meet("parabola that ends flat");
        (3.0 * own - 2.0 * end, end)
    } else {
        cases.meet("parabola that begins flat");
        (begin, 3.0 * own - 2.0 * begin)
    };
    let curve = 6.0 * (own - 0.5 * (left + right));
    let light = |x: f64| left + x * (right - left + curve * (1.0 - x));
    // Simpson's rule is exact for parabolas.
    (high - low) / 6.0 * (light(low) + 4.0 * light(0.5 * (low + high)) + light(high))
}

/// Returns the mean of a row of pixels from `low` to `high`.
fn mean(pixel: impl Fn(i64) -> DVec3, [low, high]: [f64; 2], cases: &mut Cases) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for i in low.floor() as i64..high.ceil() as i64 {
        let means: [DVec3; 5] = std::array::from_fn(|k| pixel(i + k as i64 - 2));
        let within = [(low - i as f64).max(0.0), (high - i as f64).min(1.0)];
        sum += DVec3::from_array(std::array::from_fn(|c| part(means.map(|m| m[c]), within, cases)));
    }
    sum / (high - low)
}

/// Returns the light of a display pixel at a place in an image, whose outermost pixels repeat beyond the border.
pub fn resampled(place: &Place, light: impl Fn(i64, i64) -> DVec3, size: DVec2, cases: &mut Cases) -> DVec3 {
    let centre = place.point.clamp(DVec2::splat(-4.0), size + 4.0);
    let (low, high) = (centre - 0.5 * place.widths, centre + 0.5 * place.widths);
    let rows: Vec<DVec3> = (low.y.floor() as i64 - 2..high.y.ceil() as i64 + 2)
        .map(|row| mean(|column| light(column, row), [low.x, high.x], cases))
        .collect();
    let first = low.y.floor() as i64 - 2;
    mean(|row| rows[(row - first) as usize], [low.y, high.y], cases).max(DVec3::ZERO)
}
