//! Visual-polar images: rows are rings around the gaze, columns are directions from it, and the density of rings
//! follows visual acuity (Koskela et al. 2019, "Foveated Real-Time Path Tracing in Visual-Polar Space").
//!
//! An eye's image has `rows` rings. The innermost `fovea_rows` cover the fovea: they are equally wide, and smaller
//! rings have fewer columns. Outside the fovea, the number of rings up to an eccentricity is linear in the integral of
//! acuity over the disc within that eccentricity. Departures from the paper: rings are rows rather than columns, so
//! that stripes have the same neighbours as in any image. If the gaze leaves the centre of the screen, rings get wider,
//! but the number of pixels stays the same.

use std::f64::consts::PI;

use glam::{DVec2, DVec3, Vec3};

use super::acuity::{FOVEA_DEG, acuity};
use super::method::{PolarPoint, Project};
use super::view::View;
use crate::image::Extent;

/// Maximum fraction of an image's rings that are shortened; shaders use the same value.
const MOST_SHORT: f64 = 0.5;
/// Least eccentricity assumed for the outermost ring, degrees.
const LEAST_DEG: f64 = 1e-6;
/// Area of the fovea, square degrees.
const FOVEA_AREA: f64 = PI * FOVEA_DEG * FOVEA_DEG;
/// Constant factor in the integral of acuity outside the fovea, square degrees; see [`acuity_within`].
const ACUITY_SUM: f64 = 2.0 * PI * (449.4 / 60.0) / (0.3 * 0.3);

/// The visual-polar projection.
pub struct VisualPolar;

impl Project for VisualPolar {
    fn name(&self) -> &'static str {
        "visual-polar"
    }

    fn help(&self) -> &'static str {
        "Visual-polar space: pixel density follows visual acuity"
    }

    fn include(&self) -> &'static str {
        "grid_visual_polar"
    }

    fn blur(&self) -> Option<&'static str> {
        Some("visual_polar_blur")
    }

    /// Returns two thirds of the screen's width and height, rounded up.
    fn grid(&self, screen: Extent) -> Extent {
        let of = |pixels: u32| (2 * pixels).div_ceil(3).max(1);
        Extent::new(of(screen.width), of(screen.height))
    }

    /// Returns the view with `rows` and `fovea_rows` set for its gaze. If the gaze is centred, all rows of the image
    /// are used. For any other gaze, the number of rows is set such that the number of pixels is the same.
    fn look(&self, view: View, _gaze: [f64; 2], screen: Extent) -> View {
        let share = fovea_fraction(farthest_corner(&view, view.gaze));
        let centred = fovea_fraction(farthest_corner(&view, view.forward));
        let rows = f64::from(self.grid(screen).height);
        let rows = (rows * pixel_share(centred) / pixel_share(share)).round().max(1.0);
        View { rows: rows as f32, fovea_rows: (rows * share) as f32, ..view }
    }

    fn pixels(&self, view: &View, screen: Extent) -> u64 {
        let grid = self.grid(screen);
        (0..view.rows as u32).map(|row| u64::from(row_length(view, grid, row))).sum()
    }

    fn places(&self, seen: View, screen: Extent) -> Box<dyn Fn(DVec2, DVec3) -> PolarPoint> {
        let (gaze, forward) = (seen.gaze.as_dvec3(), seen.forward.as_dvec3());
        // Solid angle of a pixel in the centre of the screen, steradians.
        let middle = (2.0 * f64::from(seen.tan_half_y) / f64::from(screen.height)).powi(2);
        let grid = self.grid(screen);
        // Density in the fovea, pixels per steradian. Outside it falls with acuity.
        let most = f64::from(seen.fovea_rows) * f64::from(grid.width) / (2.0 * PI * FOVEA_DEG.to_radians().powi(2));
        let short_rows = f64::from(short_rows(&seen, grid.height));
        Box::new(move |_, ray| {
            let degrees = degrees_between(ray, gaze);
            let row = ring_of(&seen, ray);
            // Within the fovea, shortened rings have a constant density, and full-length rings thin out as they get
            // larger.
            let thinned = if degrees < FOVEA_DEG { row.max(short_rows) / f64::from(seen.fovea_rows) } else { 1.0 };
            // The integral of acuity treats rings as circles in a plane, but on the sphere a ring's circumference is
            // proportional to the sine of its eccentricity.
            let angle = degrees.max(1e-9).to_radians();
            let density = most / thinned * acuity(degrees) * angle / angle.sin() * middle * ray.dot(forward).powi(3);
            PolarPoint { row, density }
        })
    }

    fn rows_moved(&self, now: &View, last: &View, shift: f64) -> f64 {
        // Rings are densest in the fovea.
        let per_radian = f64::from(now.fovea_rows) / FOVEA_DEG.to_radians();
        let [gaze, last_gaze] = [now, last].map(|view| view.gaze.as_dvec3());
        let turned = gaze.angle_between(last_gaze) + shift;
        // If the eccentricity of the outermost ring changes, all rings are rescaled.
        let stretched = f64::from((now.fovea_rows / last.fovea_rows - 1.0).abs() * now.rows.max(last.rows));
        turned * per_radian + stretched
    }
}

/// Returns the integral of relative acuity over the disc within an eccentricity of `degrees`, which is at least
/// [`FOVEA_DEG`]; square degrees.
fn acuity_within(degrees: f64) -> f64 {
    let part = |degrees: f64| {
        let falling = 0.3 * degrees + 1.0;
        1.0 / falling + falling.ln()
    };
    FOVEA_AREA + ACUITY_SUM * (part(degrees) - part(FOVEA_DEG))
}

/// Returns the fraction of an image's rings that belong to the fovea. `degrees` is the eccentricity of the outermost
/// ring. The fraction makes the density of rings continuous at the fovea's rim. It exceeds 1 if the fovea extends
/// beyond the image.
fn fovea_fraction(degrees: f64) -> f64 {
    1.0 / rings_within(degrees.max(LEAST_DEG))
}

/// Returns the number of an image's pixels, as a fraction of the number if all rings had full length. `share` is the
/// result of [`fovea_fraction`].
fn pixel_share(share: f64) -> f64 {
    1.0 - 0.5 * share.min(MOST_SHORT)
}

/// Returns the angle between two directions, degrees. It stays exact for small angles.
fn degrees_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Returns the row, counted from the gaze, at which an eye's image shows a direction.
fn ring_of(view: &View, direction: DVec3) -> f64 {
    f64::from(view.fovea_rows) * rings_within(degrees_between(direction, view.gaze.as_dvec3()))
}

/// Returns the number of rings up to an eccentricity, as a multiple of the number of rings in the fovea.
fn rings_within(degrees: f64) -> f64 {
    if degrees < FOVEA_DEG { degrees / FOVEA_DEG } else { 0.5 * (1.0 + acuity_within(degrees) / FOVEA_AREA) }
}

/// Returns the eccentricity of the view's corner that is farthest from `gaze`, degrees.
fn farthest_corner(view: &View, gaze: Vec3) -> f64 {
    let [forward, right, up] = [view.forward, view.right, view.up].map(Vec3::as_dvec3);
    let (right, up) = (right * f64::from(view.tan_half_x), up * f64::from(view.tan_half_y));
    let corners = [-right - up, up - right, right - up, right + up].map(|c| forward + c);
    corners.map(|c| degrees_between(gaze.as_dvec3(), c)).into_iter().fold(0.0, f64::max)
}

/// Returns the number of shortened rings: those of the fovea, up to a fraction of [`MOST_SHORT`] of all rows.
fn short_rows(view: &View, rows: u32) -> f32 {
    view.fovea_rows.min((MOST_SHORT * f64::from(rows)) as f32)
}

/// Returns the number of columns of a ring; shaders compute the same.
fn row_length(view: &View, grid: Extent, row: u32) -> u32 {
    let columns = grid.width as f32;
    let length = (columns * (row as f32 + 0.5) / short_rows(view, grid.height)).ceil();
    length.clamp(1.0, columns) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::projection::PolarSpace;
    use crate::scene::rig;

    fn view(yfov_deg: f32, aspect: f32) -> View {
        let tan_half_y = (yfov_deg.to_radians() / 2.0).tan();
        let (right, up, forward) = (Vec3::X, Vec3::Y, -Vec3::Z);
        View { tan_half_x: tan_half_y * aspect, tan_half_y, right, up, forward, ..View::default() }
    }

    /// Checks the paper's constant for 80 degrees, and fractions that follow from its formulas.
    #[test]
    fn acuity_sums_up_to_published_numbers() {
        assert!((acuity_within(80.0) - 1091.3).abs() < 1.0, "{}", acuity_within(80.0));
        for (degrees, share) in [(40.0, 0.241), (50.0, 0.216), (60.0, 0.199)] {
            assert!((fovea_fraction(degrees) - share).abs() < 1e-3, "{} at {degrees}", fovea_fraction(degrees));
        }
    }

    #[test]
    fn visual_polar_densities_add_up_to_screen_pixels() {
        let screen = Extent::new(96, 90);
        for tan_half_yfov in [0.8, 0.1, 0.02] {
            let eye = rig::View {
                origin: Vec3::ZERO,
                right: Vec3::X,
                up: Vec3::Y,
                forward: -Vec3::Z,
                tan_half_yfov,
                shift_x: 0.0,
            };
            let places = PolarSpace::Visual.places([0.5; 2], &eye, screen);
            let (grid, seen) = (VisualPolar.grid(screen), PolarSpace::Visual.seen([0.5; 2], &eye, screen));
            // Rows within the circle that touches the upper and the lower side of the screen.
            let rows = f64::from(seen.fovea_rows) * rings_within(f64::from(tan_half_yfov).atan().to_degrees());
            let within: f64 = places.iter().filter(|p| p.row < rows).map(|p| p.density).sum();
            let short = f64::from(short_rows(&seen, grid.height));
            let expected = f64::from(grid.width) * (rows - 0.5 * short);
            assert!((within / expected - 1.0).abs() < 0.02, "{tan_half_yfov}: {within} of {expected}");
        }
    }

    /// Checks narrow views: the fovea covers the whole screen if all of it is within 5.79 degrees of the gaze.
    #[test]
    fn narrow_views_have_rings_and_pixels() {
        let screen = Extent::new(640, 360);
        let grid = VisualPolar.grid(screen);
        for yfov_deg in [1e-6, 0.01, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0] {
            let eye = view(yfov_deg, 16.0 / 9.0);
            for gaze in [[0.5, 0.5], [0.3, 0.6], [0.0, 0.0], [1.0, 0.5], [0.62, 0.97]] {
                let seen = PolarSpace::Visual.look(gaze, eye, screen);
                let share = VisualPolar.pixels(&seen, screen) as f64 / screen.area() as f64;
                let told = format!("{yfov_deg} degrees, {gaze:?}: {} rows, {share} of the pixels", seen.rows);
                assert!(seen.rows >= 0.8 * grid.height as f32 && seen.rows <= grid.height as f32, "{told}");
                assert!((0.3..0.4).contains(&share), "{told}");
                // The outermost ring is at the farthest corner.
                let corner =
                    rings_within(farthest_corner(&seen, seen.gaze).max(LEAST_DEG)) * f64::from(seen.fovea_rows);
                assert!(
                    (corner / f64::from(seen.rows) - 1.0).abs() < 1e-4,
                    "{told}: the farthest corner is at {corner}"
                );
            }
        }
    }

    #[test]
    fn ring_density_is_continuous_at_the_rim_of_the_fovea() {
        for degrees in [30.0, 48.9, 75.0] {
            let share = fovea_fraction(degrees);
            let inside = share / FOVEA_DEG;
            let outside = (1.0 - share) / (acuity_within(degrees) - FOVEA_AREA) * 2.0 * PI * FOVEA_DEG;
            assert!((inside / outside - 1.0).abs() < 1e-9, "{degrees}: {inside}, {outside}");
        }
    }

    /// The paper traces 39.1 % of the pixels, wherever the gaze is.
    #[test]
    fn number_of_traced_pixels_is_independent_of_gaze() {
        for (screen, yfov_deg) in [((640, 360), 58.7), ((1280, 1440), 100.0), ((320, 180), 75.0)] {
            let screen = Extent::new(screen.0, screen.1);
            let grid = VisualPolar.grid(screen);
            let eye = view(yfov_deg, screen.width as f32 / screen.height as f32);
            let share = |gaze| {
                let seen = PolarSpace::Visual.look(gaze, eye, screen);
                assert!(seen.rows <= grid.height as f32 && seen.fovea_rows > 0.0 && seen.fovea_rows < seen.rows);
                VisualPolar.pixels(&seen, screen) as f64 / screen.area() as f64
            };
            let centred = share([0.5, 0.5]);
            assert!((centred - 0.391).abs() < 0.03, "{screen}: {centred}");
            for gaze in [[0.3, 0.6], [0.0, 0.0], [1.0, 0.5], [0.62, 0.97]] {
                assert!((share(gaze) / centred - 1.0).abs() < 0.01, "{screen}, {gaze:?}: {}", share(gaze));
            }
        }
    }
}
