//! Log-polar images (Andersson & Hansson 2020, "Performance Optimizations for Foveated Real-Time Raytracing", section
//! 3.3).
//!
//! Rings are circles on the screen, one per row. The kernel maps the row to the logarithm of the ring's radius in
//! pixels: linearly, or as the row to the power of 1 / [`LogPolar::alpha`]. Optionally, the first rows hold a square
//! image around the gaze, in which every screen pixel has its own pixel; the rings then begin at the rim of the disc
//! inside the square. Departures from the paper: rings are rows, not columns; a single image holds both parts; pixels
//! beyond the screen's edge are traced as far as filters read them.

use std::fmt::{self, Display};
use std::str::FromStr;

use glam::{DVec2, DVec3, Vec2};
use serde::{Deserialize, Serialize};

use super::method::{OutOfRange, PolarPoint, Project, within};
use super::view::View;
use crate::image::Extent;
use crate::wgsl::{Declaration, shared_structs};

/// Distances from the gaze at which the blur begins and at which it is strongest, as fractions of the diagonal. The
/// paper does not give them.
const BLUR_BEGINS: f64 = 1.0 / 6.0;
const BLUR_FULL: f64 = 1.0 / 2.0;
/// Maximum fraction of the rings that the image around the gaze may replace.
const MOST_INNER: f64 = 0.95;

/// Parameters of log-polar images (Andersson & Hansson 2020, "Performance Optimizations for Foveated Real-Time
/// Raytracing", section 3.3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LogPolar {
    /// Downsampling factor per axis, σ: the number of rings times the number of directions is 1/σ² of the screen's
    /// number of pixels.
    pub sigma: f64,
    /// Exponent of the kernel function. Values above 1 move pixels away from the gaze; 1 has no effect.
    pub alpha: f64,
    /// Angle around the gaze, radians, within which every pixel of the screen is traced; 0 disables this. The assumed
    /// viewing distance is the screen's diagonal divided by tan 60° ([`Self::DIAGONAL_DEG`]).
    pub gaze: f64,
    /// Number of rings divided by the number of directions.
    pub aspect: f64,
    /// True to blur the image with increasing distance from the gaze.
    #[serde(default = "always")]
    pub blur: bool,
}

fn always() -> bool {
    true
}

impl LogPolar {
    /// Modes of Andersson & Hansson's table 5.1: name and parameters.
    pub const PRESETS: [(&str, Self); 4] = [
        ("fov", Self::new(0.75, 1.0, 0.0, 1.2)),
        ("kernel", Self::new(1.0, 3.0, 0.0, 0.7)),
        ("composite", Self::new(1.4, 1.0, 0.2, 0.33)),
        ("composite-kernel", Self::new(1.3, 2.0, 0.15, 0.35)),
    ];
    pub const COMPOSITE: Self = Self::PRESETS[2].1;
    /// Angle in degrees whose tangent is the screen's diagonal over the assumed viewing distance.
    pub const DIAGONAL_DEG: f64 = 60.0;

    const fn new(sigma: f64, alpha: f64, gaze: f64, aspect: f64) -> Self {
        Self { sigma, alpha, gaze, aspect, blur: true }
    }

    /// Returns the shader constants for a screen of this size.
    fn map(&self, screen: Extent) -> LogPolarMap {
        let (width, height) = (f64::from(screen.width), f64::from(screen.height));
        let diagonal = width.hypot(height);
        let columns = ((width * height / self.aspect).sqrt() / self.sigma).round().max(1.0);
        let own = (columns * self.aspect).round().max(1.0);
        let radius = diagonal / LogPolar::DIAGONAL_DEG.to_radians().tan() * self.gaze.tan();
        let inner =
            if self.gaze > 0.0 { (radius.ln_1p() / diagonal.ln()).powf(self.alpha).min(MOST_INNER) } else { 0.0 };
        LogPolarMap {
            screen: Vec2::new(screen.width as f32, screen.height as f32),
            log_diagonal: diagonal.ln() as f32,
            kernel: self.alpha as f32,
            rings: (own / (1.0 - inner)) as f32,
            first_ring: (own * inner / (1.0 - inner)) as f32,
            radius: radius as f32,
            columns: columns as f32,
            blur_begins: if self.blur { (BLUR_BEGINS * diagonal) as f32 } else { f32::MAX },
            blur_full: (BLUR_FULL * diagonal) as f32,
            ..Default::default()
        }
    }
}

impl FromStr for LogPolar {
    type Err = String;

    /// Parses the name of a preset mode, or four numbers SIGMA,ALPHA,GAZE,ASPECT.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((_, preset)) = Self::PRESETS.iter().find(|(name, _)| *name == text) {
            return Ok(*preset);
        }
        let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        let Some(&[sigma, alpha, gaze, aspect]) = numbers.as_deref() else {
            let names = Self::PRESETS.map(|(name, _)| name).join(", ");
            return Err(format!("expected {names}, or four numbers"));
        };
        let read = Self::new(sigma, alpha, gaze, aspect);
        read.check().map(|()| read).map_err(|error| error.to_string())
    }
}

impl Display for LogPolar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sigma, alpha, gaze, aspect, .. } = self;
        write!(f, "{sigma},{alpha},{gaze},{aspect}")
    }
}

shared_structs! {
    /// Constants of the include.
    pub struct LogPolarMap {
        /// Size of an eye's screen, pixels.
        pub screen: Vec2,
        /// Logarithm of the screen's diagonal in pixels.
        pub log_diagonal: f32,
        /// Exponent of the kernel. Values above 1 move rings away from the gaze; 1 has no effect.
        pub kernel: f32,
        /// Number of rings up to a distance of the screen's diagonal. The image around the gaze replaces the innermost
        /// `first_ring` of them.
        pub rings: f32,
        pub first_ring: f32,
        /// Radius of the image around the gaze, pixels.
        pub radius: f32,
        /// Number of columns: directions around the gaze, the same for every ring.
        pub columns: f32,
        /// Distances from the gaze at which the blur begins and at which it is strongest, pixels.
        pub blur_begins: f32,
        pub blur_full: f32,
        pub pad0: u32,
        pub pad1: u32,
    }
}

impl Project for LogPolar {
    fn name(&self) -> &'static str {
        "log-polar"
    }

    fn help(&self) -> &'static str {
        "Log-polar space, set by polar"
    }

    fn include(&self) -> &'static str {
        "grid_log_polar"
    }

    fn blur(&self) -> Option<&'static str> {
        self.blur.then_some("log_polar_blur")
    }

    fn declaration(&self) -> Option<Declaration> {
        structs().pop()
    }

    fn constants(&self, screen: Extent) -> Vec<u8> {
        bytemuck::bytes_of(&self.map(screen)).to_vec()
    }

    fn label(&self) -> String {
        format!("{} {self}", self.name())
    }

    fn check(&self) -> Result<(), OutOfRange> {
        within("sigma", self.sigma, 0.25..=16.0)?;
        within("alpha", self.alpha, 0.25..=8.0)?;
        within("gaze", self.gaze, 0.0..=0.6)?;
        within("aspect", self.aspect, 0.05..=20.0)
    }

    /// Returns the size of images that have enough rows for any gaze.
    fn grid(&self, screen: Extent) -> Extent {
        let map = self.map(screen);
        let (square, own) = (square(&map), f64::from(map.rings - map.first_ring).round());
        Extent::new(f64::from(map.columns).max(square) as u32, (square + own) as u32)
    }

    /// Returns `view` with enough rows for its rings to reach the farthest corner of the screen.
    fn look(&self, view: View, gaze: [f64; 2], screen: Extent) -> View {
        let map = self.map(screen);
        let screen = map.screen.as_dvec2();
        let at = DVec2::from(gaze) * screen;
        let rings = ring_of(&map, at.max(screen - at).length()).ceil().max(1.0);
        let rows = square(&map) + rings.min(f64::from(map.rings - map.first_ring).round());
        View { gaze_x: at.x as f32, gaze_y: at.y as f32, rows: rows as f32, fovea_rows: square(&map) as f32, ..view }
    }

    /// Returns the number of pixels of the square and of the view's rings.
    fn pixels(&self, view: &View, screen: Extent) -> u64 {
        let (rows, square) = (f64::from(view.rows), f64::from(view.fovea_rows));
        (square * square + (rows - square) * f64::from(self.map(screen).columns)) as u64
    }

    fn traced(&self, view: &View, screen: Extent) -> u64 {
        traced(&self.map(screen), view)
    }

    fn places(&self, view: View, screen: Extent) -> Box<dyn Fn(DVec2, DVec3) -> PolarPoint> {
        let map = self.map(screen);
        Box::new(move |at, _| place(&map, &view, at))
    }
}

/// Returns the edge length of the square around the gaze, pixels.
fn square(map: &LogPolarMap) -> f64 {
    if map.radius > 0.0 { 2.0 * (f64::from(map.radius) + 1.0).ceil() } else { 0.0 }
}

/// Counts the traced pixels of an eye's image: those on the screen, or so close to it that filters read them
/// (`is_shown` in `grid.inc.wgsl`).
fn traced(map: &LogPolarMap, view: &View) -> u64 {
    let (gaze, screen) = (DVec2::new(view.gaze_x.into(), view.gaze_y.into()), map.screen.as_dvec2());
    let is_near = |at: DVec2, margin: f64| at.cmpgt(DVec2::splat(-margin)).all() && at.cmplt(screen + margin).all();
    let square = view.fovea_rows as u32;
    let in_square = |i: u32| {
        let at = DVec2::new((i % square).into(), (i / square).into()) + 0.5 - 0.5 * f64::from(square) + gaze.floor();
        at.distance(gaze) < f64::from(map.radius) + 1.0 && is_near(at, 1.0)
    };
    let on_ring = |ring: u32| {
        let share = (f64::from(ring) + 0.5 + f64::from(map.first_ring)) / f64::from(map.rings);
        let distance = (f64::from(map.log_diagonal) * share.powf(1.0 / f64::from(map.kernel))).exp();
        let densities = [rings_per_pixel(map, distance.max(1.0)), columns_per_pixel(map, distance.max(1.0))];
        let margin = 2.5 / densities[0].min(densities[1]).max(1e-6);
        let turn = move |column: u32| std::f64::consts::TAU * (f64::from(column) + 0.5) / f64::from(map.columns);
        (0..map.columns as u32).filter(|c| is_near(gaze + distance * DVec2::from_angle(turn(*c)), margin)).count()
            as u64
    };
    let inner = (0..square * square).filter(|i| in_square(*i)).count() as u64;
    inner + (0..view.rows as u32 - square).map(on_ring).sum::<u64>()
}

fn rings_per_pixel(map: &LogPolarMap, distance: f64) -> f64 {
    let (kernel, log_diagonal) = (f64::from(map.kernel), f64::from(map.log_diagonal));
    let share = (distance.ln() / log_diagonal).max(1e-6);
    f64::from(map.rings) * kernel * share.powf(kernel - 1.0) / (log_diagonal * distance)
}

fn columns_per_pixel(map: &LogPolarMap, distance: f64) -> f64 {
    f64::from(map.columns) / (std::f64::consts::TAU * distance)
}

/// Returns the number of stored rings within `distance` pixels of the gaze. The result is negative inside the image
/// around the gaze, which replaces the innermost rings.
fn ring_of(map: &LogPolarMap, distance: f64) -> f64 {
    let share = distance.max(1.0).ln() / f64::from(map.log_diagonal);
    f64::from(map.rings) * share.powf(map.kernel.into()) - f64::from(map.first_ring)
}

/// Returns the position of a screen point `at`, in pixels, in an eye's polar image.
fn place(map: &LogPolarMap, view: &View, at: DVec2) -> PolarPoint {
    let gaze = Vec2::new(view.gaze_x, view.gaze_y).as_dvec2();
    let (distance, square) = (at.distance(gaze), f64::from(view.fovea_rows));
    if distance < f64::from(map.radius) {
        return PolarPoint { row: at.y - gaze.y.floor() + 0.5 * square, density: 1.0 };
    }
    let distance = distance.max(1.0);
    let density = rings_per_pixel(map, distance) * columns_per_pixel(map, distance);
    PolarPoint { row: square + ring_of(map, distance).max(0.0), density }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_and_numbers_are_read() {
        assert_eq!("composite".parse(), Ok(LogPolar::COMPOSITE));
        assert_eq!("1.4,1,0.2,0.33".parse(), Ok(LogPolar::COMPOSITE));
        assert_eq!(LogPolar::COMPOSITE.to_string(), "1.4,1,0.2,0.33");
        for text in ["", "1,2,3", "0,1,0,1", "1,1,0.7,1", "1,NaN,0,1", "1,1,-0.1,1", "composit", "1,1,0,inf"] {
            assert!(text.parse::<LogPolar>().is_err(), "{text}");
        }
    }

    /// Checks against the paper's table 5.3, for a 1920x1080 screen with a centred gaze: all pixels, and the traced
    /// ones, in percent of the screen's.
    #[test]
    fn modes_have_as_many_pixels_as_published() {
        let screen = Extent::new(1920, 1080);
        let published = [[162.0, 154.0], [75.4, 65.7], [48.3, 37.5], [47.6, 37.7]];
        for ((name, mode), percent) in LogPolar::PRESETS.iter().zip(published) {
            let view = mode.look(View::default(), [0.5, 0.5], screen);
            let found = [mode.pixels(&view, screen), mode.traced(&view, screen)]
                .map(|n| 100.0 * n as f64 / screen.area() as f64);
            assert!((0..2).all(|i| (found[i] - percent[i]).abs() < 3.0), "{name}: {found:?} %");
            // The image has enough rows wherever the gaze is.
            let grid = mode.grid(screen);
            for gaze in [[0.0, 0.0], [1.0, 0.3], [0.7, 1.0]] {
                assert!(mode.look(View::default(), gaze, screen).rows <= grid.height as f32, "{name}, {gaze:?}");
            }
        }
    }

    /// Checks the density: one pixel per screen pixel around the gaze, and that of the rings outside.
    #[test]
    fn log_polar_densities_add_up_to_ring_pixels() {
        let (screen, middle) = (Extent::new(400, 300), DVec2::new(200.0, 150.0));
        for (name, mode) in LogPolar::PRESETS {
            let map = mode.map(screen);
            let view = mode.look(View::default(), [0.5, 0.5], screen);
            let at = |i: usize| DVec2::new((i % 400) as f64 + 0.5, (i / 400) as f64 + 0.5);
            // Closer to the gaze, the density changes within a pixel.
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
                let screen = Extent::new(width, height);
                let map = mode.map(screen);
                let (grid, view) = (mode.grid(screen), mode.look(View::default(), [0.3, 0.6], screen));
                assert!(
                    grid.width >= 1 && grid.height as f32 >= view.rows && view.rows >= 1.0,
                    "{name} {width}x{height}"
                );
                assert!(map.rings.is_finite() && map.first_ring.is_finite(), "{name} {width}x{height}");
            }
        }
    }
}
