//! Log-polar images (Andersson & Hansson 2020, "Performance Optimizations for Foveated Real-Time Raytracing", section 3.3).
//!
//! Rings are circles on the screen, and the logarithm of their radius, in pixels, grows as the kernel has it: with the row
//! alone or with a root of it. Before the rings may stand the rows of a square in which every pixel of the screen close to
//! the gaze is one of the image; rings begin at the rim of the disc within. Departures from the paper: rings are rows; the
//! two images are one; what lies beside the screen's edge is traced as far as filters read it.

use glam::{DVec2, Vec2};

use super::PolarPlace;
use crate::image::Extent;
use crate::quality::LogPolar;
use crate::stages::layout::{self, View};

/// The angle that the screen's diagonal covers where it is looked at.
const DIAGONAL_DEG: f64 = 60.0;
/// Shares of the diagonal: from where on the image is blurred, and where it is blurred most, which the paper leaves open.
const BLUR_BEGINS: f64 = 1.0 / 6.0;
const BLUR_FULL: f64 = 1.0 / 2.0;
/// Most of the kernel's range that the image around the gaze may take.
const MOST_INNER: f64 = 0.95;

/// What shaders know of the images for a screen of this size.
pub(super) fn constants(map: &LogPolar, screen: Extent) -> layout::LogPolar {
    let (width, height) = (f64::from(screen.width), f64::from(screen.height));
    let diagonal = width.hypot(height);
    let columns = ((width * height / map.aspect).sqrt() / map.sigma).round().max(1.0);
    let own = (columns * map.aspect).round().max(1.0);
    let radius = diagonal / DIAGONAL_DEG.to_radians().tan() * map.gaze.tan();
    let inner = if map.gaze > 0.0 { (radius.ln_1p() / diagonal.ln()).powf(map.alpha).min(MOST_INNER) } else { 0.0 };
    layout::LogPolar {
        screen: Vec2::new(screen.width as f32, screen.height as f32),
        log_diagonal: diagonal.ln() as f32,
        kernel: map.alpha as f32,
        rings: (own / (1.0 - inner)) as f32,
        first_ring: (own * inner / (1.0 - inner)) as f32,
        radius: radius as f32,
        columns: columns as f32,
        blur_begins: if map.blur { (BLUR_BEGINS * diagonal) as f32 } else { f32::MAX },
        blur_full: (BLUR_FULL * diagonal) as f32,
        ..Default::default()
    }
}

/// Columns and rows of the square around the gaze.
fn square(map: &layout::LogPolar) -> f64 {
    if map.radius > 0.0 { 2.0 * (f64::from(map.radius) + 1.0).ceil() } else { 0.0 }
}

/// Columns and rows of the images.
pub(super) fn grid(map: &layout::LogPolar) -> Extent {
    let (square, own) = (square(map), f64::from(map.rings - map.first_ring).round());
    Extent::new(f64::from(map.columns).max(square) as u32, (square + own) as u32)
}

/// A view whose gaze is at a point of the screen, in fractions of it: rings up to the farthest corner.
pub(super) fn look(map: &layout::LogPolar, view: View, gaze: [f64; 2]) -> View {
    let screen = map.screen.as_dvec2();
    let at = DVec2::from(gaze) * screen;
    let rings = ring_of(map, at.max(screen - at).length()).ceil().max(1.0);
    let rows = square(map) + rings.min(f64::from(map.rings - map.first_ring).round());
    View { gaze_x: at.x as f32, gaze_y: at.y as f32, rows: rows as f32, fovea_rows: square(map) as f32, ..view }
}

/// The pixels of an eye's image that are there.
pub(super) fn pixels(map: &layout::LogPolar, view: &View) -> u64 {
    let (rows, square) = (f64::from(view.rows), f64::from(view.fovea_rows));
    (square * square + (rows - square) * f64::from(map.columns)) as u64
}

/// Rings within a distance from the gaze, pixels.
fn ring_of(map: &layout::LogPolar, distance: f64) -> f64 {
    let share = distance.max(1.0).ln() / f64::from(map.log_diagonal);
    f64::from(map.rings) * share.powf(map.kernel.into()) - f64::from(map.first_ring)
}

/// Where a point of the screen is.
pub(super) fn place(map: &layout::LogPolar, view: &View, at: DVec2) -> PolarPlace {
    let gaze = Vec2::new(view.gaze_x, view.gaze_y).as_dvec2();
    let (distance, square) = (at.distance(gaze), f64::from(view.fovea_rows));
    if distance < f64::from(map.radius) {
        return PolarPlace { row: at.y - gaze.y.floor() + 0.5 * square, density: 1.0 };
    }
    let (distance, kernel) = (distance.max(1.0), f64::from(map.kernel));
    let log_diagonal = f64::from(map.log_diagonal);
    let per_pixel = f64::from(map.rings) * kernel * (distance.ln() / log_diagonal).powf(kernel - 1.0) / log_diagonal;
    let density = per_pixel * f64::from(map.columns) / (std::f64::consts::TAU * distance * distance);
    PolarPlace { row: square + ring_of(map, distance).max(0.0), density }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the paper's table 5.3: rays over the pixels of a screen of 1920x1080, the gaze in its middle.
    #[test]
    fn modes_have_as_many_pixels_as_published() {
        let screen = Extent::new(1920, 1080);
        for ((name, mode), percent) in LogPolar::PRESETS.iter().zip([162.0, 75.4, 48.3, 47.6]) {
            let map = constants(mode, screen);
            let view = look(&map, View::default(), [0.5, 0.5]);
            let share = 100.0 * pixels(&map, &view) as f64 / screen.area() as f64;
            assert!((share - percent).abs() < 3.0, "{name}: {share} %");
            // Wherever the gaze is, there is a row for all that is seen.
            let grid = grid(&map);
            for gaze in [[0.0, 0.0], [1.0, 0.3], [0.7, 1.0]] {
                assert!(look(&map, View::default(), gaze).rows <= grid.height as f32, "{name}, {gaze:?}");
            }
        }
    }

    /// Around the gaze there is one of the image for each pixel, and then those of rings.
    #[test]
    fn densities_add_up_to_the_pixels_of_a_ring_on_the_screen() {
        let (screen, middle) = (Extent::new(400, 300), DVec2::new(200.0, 150.0));
        for (name, mode) in LogPolar::PRESETS {
            let map = constants(&mode, screen);
            let view = look(&map, View::default(), [0.5, 0.5]);
            let at = |i: usize| DVec2::new((i % 400) as f64 + 0.5, (i / 400) as f64 + 0.5);
            // Closer to the gaze, density changes within pixels.
            let within = |i: &usize| (10.0..150.0).contains(&at(*i).distance(middle));
            let found: f64 = (0..screen.area()).filter(within).map(|i| place(&map, &view, at(i)).density).sum();
            let radius = f64::from(map.radius).max(10.0);
            let rings = ring_of(&map, 150.0) - ring_of(&map, radius);
            let expected = std::f64::consts::PI * (radius * radius - 100.0) + rings * f64::from(map.columns);
            assert!((found / expected - 1.0).abs() < 0.02, "{name}: {found} of {expected}");
        }
    }

    #[test]
    fn screens_of_any_size_have_an_image() {
        for (width, height) in [(1, 1), (2, 1), (64, 1), (3, 200), (8192, 8192)] {
            for (name, mode) in LogPolar::PRESETS {
                let map = constants(&mode, Extent::new(width, height));
                let (grid, view) = (grid(&map), look(&map, View::default(), [0.3, 0.6]));
                assert!(
                    grid.width >= 1 && grid.height as f32 >= view.rows && view.rows >= 1.0,
                    "{name} {width}x{height}"
                );
                assert!(map.rings.is_finite() && map.first_ring.is_finite(), "{name} {width}x{height}");
            }
        }
    }
}
