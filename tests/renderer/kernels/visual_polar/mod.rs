//! Visual-polar images: compares rays and image points with the formulas in f64, and tests neighbours on rings and the
//! map to the screen.

mod blur;

use std::f64::consts::{PI, TAU};

use diptych::layout::{Camera, Display, Frame, PassConstants, View};
use diptych::projection::PolarSpace;
use glam::{DVec2, DVec3, Vec2, Vec3, Vec3Swizzles};

use super::camera::{Eye, STORAGE_SCALE};
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{Cases, Random};

const FOVEA_DEG: f64 = 5.79;
const FOVEA_AREA: f64 = PI * FOVEA_DEG * FOVEA_DEG;

/// Returns acuity in cycles per degree, relative to the fovea.
fn acuity(degrees: f64) -> f64 {
    if degrees < FOVEA_DEG { 1.0 } else { 449.4 / 60.0 / (0.3 * degrees + 1.0).powi(2) }
}

/// Integrates acuity over the disc within an eccentricity, by Simpson's rule.
fn acuity_within(degrees: f64) -> f64 {
    const STEPS: u32 = 200;
    let step = (degrees - FOVEA_DEG) / f64::from(STEPS);
    let at = |i: u32| {
        let e = FOVEA_DEG + step * f64::from(i);
        TAU * e * acuity(e.max(FOVEA_DEG + 1e-9))
    };
    let inner: f64 = (1..STEPS).map(|i| at(i) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
    FOVEA_AREA + (at(0) + inner + at(STEPS)) * step / 3.0
}

/// An eye's visual-polar image.
pub struct Polar {
    pub eye: Eye,
    gaze: DVec3,
    right: DVec3,
    pub columns: u32,
    pub rows: u32,
    fovea_rows: f64,
}

impl Polar {
    pub fn new(gaze: DVec2) -> Self {
        Self::with_fovea(gaze, 0.21)
    }

    /// Creates an image. `fovea` is the number of rings in the fovea over those of the image; above 1 the image ends
    /// within the fovea.
    fn with_fovea(gaze: DVec2, fovea: f64) -> Self {
        let eye = Eye::at_origin(Vec2::new(1.0, 0.6)).moved(DVec3::new(0.2, -0.1, 0.4), 0.3, -0.2);
        let (right, up, forward) = (eye.right.as_dvec3(), eye.up.as_dvec3(), eye.forward.as_dvec3());
        let gaze = (forward + right * gaze.x + up * gaze.y).normalize();
        let gaze_right = (right - gaze * gaze.dot(right)).normalize();
        let (columns, rows) = (214, 120);
        Self { eye, gaze, right: gaze_right, columns, rows, fovea_rows: f64::from(rows) * fovea }
    }

    pub fn frame(&self) -> Frame {
        let view = View {
            rows: self.rows as f32,
            fovea_rows: self.fovea_rows as f32,
            gaze: self.gaze.as_vec3(),
            gaze_right: self.right.as_vec3(),
            ..self.eye.view()
        };
        let (width, height, centre) = (self.columns, self.rows, Vec2::splat(0.5));
        Frame {
            camera: Camera { views: [view; 2], centre, width, height, ..Default::default() },
            display: Display { exposure: 1.0, storage_scale: STORAGE_SCALE, ..Default::default() },
            ..Default::default()
        }
    }

    pub fn length(&self, row: u32) -> u32 {
        let short = self.fovea_rows.min(0.5 * f64::from(self.rows));
        let length = (f64::from(self.columns) * (f64::from(row) + 0.5) / short).ceil();
        (length as u32).clamp(1, self.columns)
    }

    pub fn pixels(&self) -> impl Iterator<Item = (u32, u32)> {
        (0..self.rows).flat_map(|row| (0..self.length(row)).map(move |column| (column, row)))
    }

    /// Returns an image with values that are not finite where there are no pixels.
    pub fn image(&self, mut texel: impl FnMut(u32, u32) -> [f32; 4]) -> Vec<[f32; 4]> {
        let mut image = vec![[f32::NAN; 4]; (self.columns * self.rows) as usize];
        self.pixels().for_each(|(column, row)| image[(row * self.columns + column) as usize] = texel(column, row));
        image
    }

    /// Returns the eccentricity of a row: the angle within which the integral of acuity reaches it.
    fn eccentricity(&self, row: f64) -> f64 {
        if row < self.fovea_rows {
            return FOVEA_DEG * row / self.fovea_rows;
        }
        let sum = FOVEA_AREA * (2.0 * row / self.fovea_rows - 1.0);
        let (mut low, mut high) = (FOVEA_DEG, 120.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if acuity_within(middle) < sum { low = middle } else { high = middle }
        }
        low
    }

    /// Returns the row of an eccentricity in degrees.
    fn row_of(&self, degrees: f64) -> f64 {
        if degrees < FOVEA_DEG {
            return self.fovea_rows * degrees / FOVEA_DEG;
        }
        0.5 * self.fovea_rows * (1.0 + acuity_within(degrees) / FOVEA_AREA)
    }

    /// Returns the place of a direction: whole turns around the gaze, and the row.
    pub fn place_of(&self, ray: DVec3) -> DVec2 {
        let up = self.right.cross(self.gaze);
        let turn = ray.dot(up).atan2(ray.dot(self.right)) / TAU;
        DVec2::new(turn.rem_euclid(1.0), self.row_of(ray.angle_between(self.gaze).to_degrees()))
    }

    fn ray(&self, column: f64, row: f64, length: u32) -> DVec3 {
        let (e, turn) = (self.eccentricity(row).to_radians(), TAU * column / f64::from(length));
        let up = self.right.cross(self.gaze);
        self.gaze * e.cos() + (self.right * turn.cos() + up * turn.sin()) * e.sin()
    }
}

const GAZES: [DVec2; 3] = [DVec2::ZERO, DVec2::new(-0.5, 0.3), DVec2::new(0.9, -0.5)];

#[test]
fn visual_polar_rays_follow_acuity_and_round_trip() {
    const OFFSET: DVec2 = DVec2::new(0.25, 0.75);
    const ROUND_TRIP: &str = "
@group(1) @binding(0) var<storage, read_write> rays: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> points: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    let fovea_rows = frame.camera.views[1].fovea_rows;
    if f32(pixel.x) >= row_length(fovea_rows, i32(pixel.y)) || f32(pixel.y) >= frame.camera.views[1].rows {
        return;
    }
    let at = pixel.y * frame.camera.width + pixel.x;
    let offset = vec2<f32>(0.25, 0.75);
    let ray = ray_of(1u, vec2<f32>(pixel) + offset);
    rays[at] = vec4<f32>(ray, 0.0);
    let eye = frame.camera.views[1];
    points[at] = vec4<f32>(pixel_of(eye.origin + 4.0 * ray, eye).xy, point_in(vec2<f32>(pixel), offset));
}
";
    let narrow = [0.7, 1.8].map(|fovea| Polar::with_fovea(GAZES[1], fovea));
    for polar in GAZES.map(Polar::new).into_iter().chain(narrow) {
        let (gaze, fovea_rows) = (polar.gaze, polar.fovea_rows);
        let (width, height) = (polar.columns, polar.rows);
        let pass = PassConstants { view: 1, width, height, row_end: height, ..Default::default() };
        let nothing = vec![[0f32; 4]; (width * height) as usize];
        let buffers = [("rays", Buffer::whole(&nothing)), ("points", Buffer::whole(&nothing))];
        let kernel = Kernel::beside("visual_polar_blur", &[], ROUND_TRIP);
        let outputs = kernel.run_rows(&polar.frame(), pass, &buffers);
        let (rays, points) = (outputs.get::<[f32; 4]>("rays"), outputs.get::<[f32; 4]>("points"));
        let (mut off_ray, mut off_point): (f64, f64) = (0.0, 0.0);
        for (column, row) in polar.pixels() {
            let at = (row * polar.columns + column) as usize;
            let length = polar.length(row);
            let expected = polar.ray(f64::from(column) + OFFSET.x, f64::from(row) + OFFSET.y, length);
            off_ray = off_ray.max((Vec3::from_slice(&rays[at]).as_dvec3() - expected).length());
            let [x, y, wanted_x, wanted_y] = points[at].map(f64::from);
            // Error in pixels of the row.
            let columns = (x - wanted_x) * f64::from(length) / f64::from(polar.columns);
            off_point = off_point.max(columns.abs()).max((y - wanted_y).abs());
        }
        assert!(off_ray < 3e-5, "{gaze}, {fovea_rows}: rays are off by {off_ray}");
        // An angle has a rounding error, and narrow views have more rings per angle.
        let allowed = 1e-3 * (fovea_rows / 40.0).max(1.0);
        assert!(off_point < allowed, "{gaze}, {fovea_rows}: image points are off by {off_point} pixels");
    }
}

#[test]
fn visual_polar_neighbours_keep_their_direction() {
    const OFFSETS: [(i32, i32); 6] = [(1, 0), (-1, 0), (0, 1), (3, -2), (-16, 16), (16, -1)];
    let polar = Polar::new(GAZES[1]);
    let groups = [polar.columns.div_ceil(8), polar.rows.div_ceil(8)];
    let kernel = Kernel::beside("visual_polar_blur", &[], crate::kernels::log_polar::NEIGHBOURS);
    for (dx, dy) in OFFSETS {
        let (valid, height) = (20..polar.rows, polar.rows);
        let stripe = Stripe { rows: 24..height, valid: valid.clone() };
        let pass = PassConstants { width: polar.columns, height, ..stripe.pass(0, [dx as u32, dy as u32, 0]) };
        let nothing = vec![[0i32; 4]; (polar.columns * height) as usize];
        let found = kernel.run_frame(&polar.frame(), pass, groups, &[("found", Buffer::whole(&nothing))]);
        let found = found.get::<[i32; 4]>("found");
        for (column, row) in polar.pixels() {
            let [x, y, is_there, is_set] = found[(row * polar.columns + column) as usize];
            assert_eq!(is_set, 1, "{column}, {row} is no pixel");
            let there = row.checked_add_signed(dy).filter(|y| valid.contains(y));
            assert_eq!(is_there == 1, there.is_some(), "{column}, {row}");
            let ring = row.saturating_add_signed(dy).clamp(valid.start, valid.end - 1);
            assert_eq!(y as u32, ring, "{column}, {row}");
            let (from, to) = (f64::from(polar.length(row)), f64::from(polar.length(ring)));
            assert!((0..to as i32).contains(&x), "{column}, {row}: {x} of {to}");
            // Difference in whole turns, the short way.
            let turns = (f64::from(column) + f64::from(dx) + 0.5) / from - (f64::from(x) + 0.5) / to;
            let off = (turns - turns.round()).abs() * to;
            assert!(off <= 0.5 + 1e-3, "{column}, {row}: {off} columns beside its direction");
        }
    }
}

/// Returns smooth light that differs in all directions from the gaze.
fn light_from(direction: DVec3) -> DVec3 {
    DVec3::splat(1.5) + direction + 0.3 * (direction.yzx() * 9.0).map(f64::sin)
}

#[test]
fn to_screen_places_light_in_its_direction() {
    let (width, height) = (96, 58);
    for gaze in GAZES {
        let polar = Polar::new(gaze);
        let image = polar.image(|column, row| {
            let ray = polar.ray(f64::from(column) + 0.5, f64::from(row) + 0.5, polar.length(row));
            light_from(ray).as_vec3().extend(1.0).to_array()
        });
        let pass = PassConstants { row_end: height, width, height, ..Default::default() };
        let area = (width * height) as usize;
        let buffers = [
            ("polar", Buffer::whole(&image)),
            ("linear", Buffer::whole(&vec![[0f32; 4]; area])),
            ("display", Buffer::whole(&vec![0u32; area])),
        ];
        let kernel = Kernel::projected(Some(PolarSpace::Visual), "to_screen", &[]);
        let outputs = kernel.run_rows(&polar.frame(), pass, &buffers);
        let linear = outputs.get::<[f32; 4]>("linear");
        for (i, found) in (0..).zip(linear) {
            let at = DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
            let ray = polar.eye.ray(at, DVec2::new(width.into(), height.into()));
            // There is no image beyond the outermost ring.
            let e = ray.angle_between(polar.gaze).to_degrees();
            if e > polar.eccentricity(f64::from(polar.rows) - 1.0) {
                continue;
            }
            let off = (Vec3::from_slice(&found).as_dvec3() - light_from(ray)).abs().max_element();
            assert!(off < 0.05, "{gaze}: {off} at {at}, {e} degrees from the gaze");
        }
    }
}

#[test]
fn aov_to_screen_reads_the_pixel_of_each_direction() {
    let (width, height) = (96, 58);
    let mut cases = Cases::default();
    for gaze in GAZES {
        let polar = Polar::new(gaze);
        let before = Random::new(181).rubbish::<4>((width * height) as usize);
        for rows in [0..height, 20..29, 49..height] {
            let stripe = Stripe { valid: 0..height, rows };
            let pass = PassConstants { width, height, ..stripe.pass(1, [0; 3]) };
            let numbered = polar.image(|column, row| [column as f32, row as f32, 0.5, 2.0]);
            let buffers = [("polar", Buffer::whole(&numbered)), ("aov", Buffer::image(&before))];
            let kernel = Kernel::projected(Some(PolarSpace::Visual), "aov_to_screen", &[]);
            let outputs = kernel.run_rows(&polar.frame(), pass, &buffers);
            let aov = outputs.get::<[f32; 4]>("aov");
            for (x, y) in stripe.pixels(width) {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let place = polar.place_of(polar.eye.ray(at, DVec2::new(width.into(), height.into())));
                // The outermost ring is extended beyond its edge.
                let row = (place.y as u32).min(polar.rows - 1);
                let column = place.x * f64::from(polar.length(row));
                let is_beyond = place.y > f64::from(polar.rows) + 0.1;
                // All columns meet at the gaze.
                let is_clear = |v: f64, off: f64| (v - v.round()).abs() > off;
                if place.y < 0.1 || !(is_beyond || is_clear(place.y, 2e-3)) || !is_clear(column, 2e-3) {
                    cases.meet("left to rounding");
                    continue;
                }
                cases.meet(match row {
                    _ if is_beyond => "beyond the rings",
                    row if f64::from(row) < polar.fovea_rows => "fovea",
                    _ => "periphery",
                });
                let expected = [column.floor() as f32, row as f32, 0.5, 2.0];
                assert_eq!(aov[(y * width + x) as usize], expected, "{gaze}: {at}");
            }
        }
    }
    cases.assert_met(&["fovea", "periphery", "beyond the rings"]);
    assert!(cases.count("left to rounding") < 500, "{} are left to rounding", cases.count("left to rounding"));
}
