//! Log-polar images: compares rays, image points and traced pixels with the formulas in f64, and tests neighbours,
//! blur, and the map of auxiliary images to the screen.

use std::f64::consts::TAU;

use diptych::layout::{Camera, Frame, PassConstants, View};
use diptych::projection::{LogPolar, LogPolarMap, PolarSpace};
use diptych::wgsl::Words;
use glam::{DVec2, DVec3, Vec2, Vec3};

use super::camera::Eye;
use super::harness::{Buffer, Kernel, Stripe, only_in};
use super::inputs::{Cases, Random};
use super::pack::rgb;

/// An eye's log-polar image of a screen (section 3.3 of the paper).
struct Image {
    mode: LogPolar,
    screen: DVec2,
    gaze: DVec2,
    eye: Eye,
}

impl Image {
    fn new(mode: LogPolar, [width, height]: [f64; 2], gaze: DVec2) -> Self {
        let screen = DVec2::new(width, height);
        let tan = Vec2::new(0.6 * (width / height) as f32, 0.6);
        Self { mode, screen, gaze: gaze * screen, eye: Eye::at_origin(tan) }
    }

    fn columns(&self) -> f64 {
        ((self.screen.x * self.screen.y / self.mode.aspect).sqrt() / self.mode.sigma).round()
    }

    fn own_rings(&self) -> f64 {
        (self.columns() * self.mode.aspect).round()
    }

    fn log_diagonal(&self) -> f64 {
        self.screen.length().ln()
    }

    fn radius(&self) -> f64 {
        self.screen.length() / 60f64.to_radians().tan() * self.mode.gaze.tan()
    }

    fn square(&self) -> f64 {
        if self.mode.gaze > 0.0 { 2.0 * (self.radius() + 1.0).ceil() } else { 0.0 }
    }

    /// Returns w_C and u_G.
    fn rings(&self) -> [f64; 2] {
        let inner = if self.mode.gaze > 0.0 { (self.radius() + 1.0).ln() / self.log_diagonal() } else { 0.0 };
        let inner = inner.powf(self.mode.alpha);
        [1.0, inner].map(|share| self.own_rings() * share / (1.0 - inner))
    }

    fn ring_of(&self, distance: f64) -> f64 {
        let [all, first] = self.rings();
        (distance.ln() / self.log_diagonal()).powf(self.mode.alpha) * all - first
    }

    fn distance(&self, ring: f64) -> f64 {
        let [all, first] = self.rings();
        (self.log_diagonal() * ((ring + first) / all).powf(1.0 / self.mode.alpha)).exp()
    }

    fn rows(&self) -> u32 {
        let farthest = self.gaze.max(self.screen - self.gaze).length();
        (self.square() + self.ring_of(farthest).ceil().min(self.own_rings())) as u32
    }

    fn width(&self) -> u32 {
        self.columns().max(self.square()) as u32
    }

    fn length(&self, row: u32) -> u32 {
        if f64::from(row) < self.square() { self.square() as u32 } else { self.columns() as u32 }
    }

    fn pixels(&self) -> impl Iterator<Item = (u32, u32)> {
        (0..self.rows()).flat_map(|row| (0..self.length(row)).map(move |column| (column, row)))
    }

    /// Returns the screen position of a place in a row.
    fn on_screen(&self, column: f64, row: f64) -> DVec2 {
        if row < self.square() {
            return self.gaze.floor() - 0.5 * self.square() + DVec2::new(column, row);
        }
        self.gaze + self.distance(row - self.square()) * DVec2::from_angle(TAU * column / self.columns())
    }

    fn map(&self) -> LogPolarMap {
        let [rings, first_ring] = self.rings();
        LogPolarMap {
            screen: self.screen.as_vec2(),
            log_diagonal: self.log_diagonal() as f32,
            kernel: self.mode.alpha as f32,
            rings: rings as f32,
            first_ring: first_ring as f32,
            radius: self.radius() as f32,
            columns: self.columns() as f32,
            ..Default::default()
        }
    }

    fn projection(&self) -> (&'static str, Buffer) {
        ("projection", Buffer::whole(&[self.map()]))
    }

    fn frame(&self) -> Frame {
        let view = View {
            rows: self.rows() as f32,
            fovea_rows: self.square() as f32,
            gaze_x: self.gaze.x as f32,
            gaze_y: self.gaze.y as f32,
            ..self.eye.view()
        };
        let (width, height) = (self.width(), self.rows());
        let camera =
            Camera { views: [view; 2], centre: Vec2::splat(0.5), width, height, display_maps: Default::default() };
        Frame { camera, ..Default::default() }
    }

    fn pass(&self) -> PassConstants {
        let (width, height) = (self.width(), self.rows());
        PassConstants { view: 1, width, height, row_end: height, valid_end: height, ..Default::default() }
    }

    /// Returns a value for every texel, also for those that are no pixels.
    fn filled<T: Clone>(&self, value: T) -> Vec<T> {
        vec![value; (self.width() * self.rows()) as usize]
    }

    fn index(&self, column: u32, row: u32) -> usize {
        (row * self.width() + column) as usize
    }
}

const GAZES: [DVec2; 3] = [DVec2::splat(0.5), DVec2::new(0.3, 0.71), DVec2::new(0.98, 0.05)];

#[test]
fn log_polar_rays_round_trip_through_screen_points() {
    const ROUND_TRIP: &str = "
@group(1) @binding(0) var<storage, read_write> rays: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> points: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if is_outside(id.xy) {
        return;
    }
    let at = pixel_index(id.xy);
    let offset = vec2<f32>(0.25, 0.75);
    let ray = ray_of(1u, vec2<f32>(id.xy) + offset);
    rays[at] = vec4<f32>(ray, 0.0);
    let eye = frame.camera.views[1];
    points[at] = vec4<f32>(pixel_of(eye.origin + 4.0 * ray, eye).xy, point_in(vec2<f32>(id.xy), offset));
}
";
    let offset = DVec2::new(0.25, 0.75);
    let kernel = Kernel::beside("log_polar_blur", &[], ROUND_TRIP);
    for ((name, mode), gaze) in LogPolar::PRESETS.iter().flat_map(|mode| GAZES.map(|gaze| (mode, gaze))) {
        let image = Image::new(*mode, [213.0, 120.0], gaze);
        let nothing = image.filled([0f32; 4]);
        let buffers = [("rays", Buffer::whole(&nothing)), ("points", Buffer::whole(&nothing)), image.projection()];
        let outputs = kernel.run_rows(&image.frame(), image.pass(), &buffers);
        let (rays, points) = (outputs.get::<[f32; 4]>("rays"), outputs.get::<[f32; 4]>("points"));
        let (mut off_ray, mut off_point): (f64, f64) = (0.0, 0.0);
        for (column, row) in image.pixels() {
            let at = image.index(column, row);
            let place = DVec2::new(f64::from(column), f64::from(row)) + offset;
            let seen = image.on_screen(place.x, place.y);
            let expected = image.eye.ray(seen, image.screen);
            off_ray = off_ray.max((Vec3::from_slice(&rays[at]).as_dvec3() - expected).length());
            // Compare only points that are unambiguous: rings outside the image around the gaze, points of that image
            // inside it, both at least a pixel from the gaze.
            let distance = seen.distance(image.gaze);
            let is_in_square = place.y < image.square();
            if is_in_square == (distance < image.radius()) && distance > 1.01 {
                let [x, y, wanted_x, wanted_y] = points[at].map(f64::from);
                let columns = (x - wanted_x) * f64::from(image.length(row)) / f64::from(image.width());
                off_point = off_point.max(columns.abs()).max((y - wanted_y).abs());
            }
        }
        assert!(off_ray < 3e-5, "{name}, {gaze}: rays are off by {off_ray}");
        assert!(off_point < 1e-3, "{name}, {gaze}: image points are off by {off_point} pixels");
    }
}

/// Table 5.3 of the paper: traced rays over the pixels of a screen of 1920x1080.
#[test]
fn log_polar_traces_the_published_number_of_pixels() {
    const SHOWN: &str = "
@group(1) @binding(0) var<storage, read_write> shown: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if !is_outside(id.xy) {
        shown[pixel_index(id.xy)] = select(0u, 1u, is_shown(id.xy));
    }
}
";
    let kernel = Kernel::beside("log_polar_blur", &[], SHOWN);
    for ((name, mode), percent) in LogPolar::PRESETS.iter().zip([154.0, 65.7, 37.5, 37.7]) {
        let image = Image::new(*mode, [1920.0, 1080.0], GAZES[0]);
        let buffers = [("shown", Buffer::whole(&image.filled(0u32))), image.projection()];
        let shown = kernel.run_rows(&image.frame(), image.pass(), &buffers);
        let count: u32 = shown.get::<u32>("shown").into_iter().sum();
        let share = 100.0 * f64::from(count) / (1920.0 * 1080.0);
        assert!((share - percent).abs() < 3.0, "{name}: {share} %");
    }
}

/// Finds the pixel beside each one in a polar image.
pub const NEIGHBOURS: &str = "
@group(1) @binding(0) var<storage, read_write> found: array<vec4<i32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if is_outside(id.xy) {
        return;
    }
    let there = beside(id.xy, vec2<i32>(i32(pass_.args.axis), i32(pass_.args.reach)));
    found[pixel_index(id.xy)] = vec4<i32>(there.pixel, select(0, 1, there.is_there), 1);
}
";

#[test]
fn log_polar_neighbours_stay_in_the_same_image() {
    let image = Image::new(LogPolar::COMPOSITE, [96.0, 80.0], GAZES[1]);
    let (rim, columns, rows) = (image.square() as i32, image.columns() as i32, image.rows() as i32);
    let kernel = Kernel::beside("log_polar_blur", &[], NEIGHBOURS);
    for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (3, -2), (-16, 16), (16, -1)] {
        let pass = PassConstants { args: Words([dx as u32, dy as u32, 0]), valid_begin: 3, ..image.pass() };
        let buffers = [("found", Buffer::whole(&image.filled([0i32; 4]))), image.projection()];
        let found = kernel.run_rows(&image.frame(), pass, &buffers);
        let found = found.get::<[i32; 4]>("found");
        for (column, row) in image.pixels() {
            let (x, y) = (column as i32 + dx, row as i32 + dy);
            let is_in_square = (row as i32) < rim;
            let (first, end) = if is_in_square { (3, rim) } else { (rim, rows) };
            let held_y = y.clamp(first, end - 1);
            let held_x = if is_in_square { x.clamp(0, rim - 1) } else { x.rem_euclid(columns) };
            let is_there = held_y == y && (!is_in_square || held_x == x);
            let expected = [held_x, held_y, is_there.into(), 1];
            assert_eq!(found[image.index(column, row)], expected, "{column}, {row} by {dx}, {dy}");
        }
    }
}

#[test]
fn log_polar_aovs_read_the_pixel_of_a_point() {
    let (width, height) = (96, 80);
    let mut cases = Cases::default();
    for ((_, mode), gaze) in LogPolar::PRESETS.iter().flat_map(|mode| GAZES.map(|gaze| (mode, gaze))) {
        let image = Image::new(*mode, [width, height].map(f64::from), gaze);
        let mut polar = image.filled([f32::NAN; 4]);
        for (column, row) in image.pixels() {
            polar[image.index(column, row)] = [column as f32, row as f32, 0.5, 2.0];
        }
        let before = Random::new(191).rubbish::<4>((width * height) as usize);
        for rows in [0..height, 30..41] {
            let stripe = Stripe { valid: 0..height, rows };
            let pass = PassConstants { width, height, ..stripe.pass(1, [0; 3]) };
            let buffers = [("polar", Buffer::whole(&polar)), ("aov", Buffer::image(&before)), image.projection()];
            let kernel = Kernel::projected(Some(PolarSpace::Log(*mode)), "aov_to_screen", &[]);
            let outputs = kernel.run_rows(&image.frame(), pass, &buffers);
            let aov = outputs.get::<[f32; 4]>("aov");
            for (x, y) in stripe.pixels(width) {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let away = at - image.gaze;
                let distance = away.length();
                let is_around_gaze = distance < image.radius();
                let place = if is_around_gaze {
                    at - image.gaze.floor() + 0.5 * image.square()
                } else {
                    let turn = (away.to_angle() / TAU).rem_euclid(1.0);
                    DVec2::new(turn * image.columns(), image.square() + image.ring_of(distance))
                };
                // Closer than a pixel there is only the innermost ring.
                let is_clear = (place - place.round()).abs().min_element() > 2e-3 && distance > 1.01;
                if !is_around_gaze && !is_clear || (distance - image.radius()).abs() < 1e-3 {
                    cases.meet("left to rounding");
                    continue;
                }
                // Rings begin a pixel beyond the square's disc.
                let first = if is_around_gaze { 0 } else { image.square() as u32 };
                let [column, row] = [place.x.floor() as u32, (place.y as u32).clamp(first, image.rows() - 1)];
                cases.meet(if is_around_gaze { "around the gaze" } else { "rings" });
                let expected = [column as f32, row as f32, 0.5, 2.0];
                assert_eq!(aov[(y * width + x) as usize], expected, "{at}, gaze at {}", image.gaze);
            }
        }
    }
    let [gaze, rings, unclear] = ["around the gaze", "rings", "left to rounding"].map(|case| cases.count(case));
    assert!(gaze > 100 && rings > 100 && 50 * unclear < rings, "{gaze}, {rings}, {unclear} are left to rounding");
}

/// Tests the blur of section 3.5 of the paper: Gaussian weights of 1, 2 and 1, scaled with the distance.
#[test]
fn log_polar_blur_grows_with_distance_from_gaze() {
    let mut random = Random::new(192);
    let mut cases = Cases::default();
    let image = Image::new(LogPolar::COMPOSITE, [96.0, 80.0], GAZES[1]);
    let (rim, columns, rows) = (image.square() as u32, image.columns() as u32, image.rows());
    let mut source = image.filled([f32::NAN; 4]);
    for (column, row) in image.pixels() {
        let color = DVec3::from_array(std::array::from_fn(|_| random.within(0.0..1.0)));
        source[image.index(column, row)] = color.as_vec3().extend(9.0).to_array();
    }
    let before = random.rubbish::<4>(source.len());
    let stripes = [(0..rows, 0..rows), (rim - 3..rim + 9, rim - 4..rim + 10), (rim + 5..rows, rim + 5..rows)];
    let kinds = [[12.0, 40.0], [30.0, 30.0]].into_iter().flat_map(|blur| [(blur, 0), (blur, 1)]);
    let runs = stripes.into_iter().flat_map(|stripe| kinds.clone().map(move |kind| (stripe.clone(), kind)));
    for (stripe, ([begins, full], axis)) in runs {
        let stripe = Stripe { rows: stripe.0, valid: stripe.1 };
        let map = LogPolarMap { blur_begins: begins as f32, blur_full: full as f32, ..image.map() };
        let pass = PassConstants { width: image.width(), height: rows, ..stripe.pass(1, [axis, 1, 0]) };
        let readable = if axis == 0 { &stripe.rows } else { &stripe.valid };
        let buffers = [
            ("source", Buffer::image(&only_in(readable, image.width(), &source))),
            ("blurred", Buffer::image(&before)),
            ("projection", Buffer::whole(&[map])),
        ];
        let outputs = Kernel::new("log_polar_blur", &[]).run_rows(&image.frame(), pass, &buffers);
        let found = outputs.get::<[u32; 4]>("blurred");
        for (x, y) in stripe.pixels(image.width()) {
            let at = image.index(x, y);
            if x >= image.length(y) {
                assert_eq!(found[at], before[at], "({x}, {y}) is no pixel");
                continue;
            }
            let light = |x: u32, y: u32| rgb(source[image.index(x, y)]);
            let mut want = light(x, y);
            let distance = if y < rim { 0.0 } else { image.distance(f64::from(y - rim) + 0.5) };
            if y >= rim && begins < full && distance > begins {
                let share = ((distance - begins) / (full - begins)).min(1.0);
                let [low, high] = [stripe.valid.start.max(rim), stripe.valid.end.min(rows) - 1];
                let [one, other] = match axis {
                    0 => [light((x + columns - 1) % columns, y), light((x + 1) % columns, y)],
                    _ => [light(x, (y - 1).max(low)), light(x, (y + 1).min(high))],
                };
                let gaussian = 0.25 * one + 0.5 * want + 0.25 * other;
                want = want.lerp(gaussian, share);
                cases.meet(if share < 1.0 { "a share" } else { "in full" });
            } else {
                cases.meet(if y < rim { "around the gaze" } else { "as it was" });
            }
            let off = (rgb(found[at].map(f32::from_bits)) - want).abs().max_element();
            assert!(off < 1e-4, "({x}, {y}) of {stripe:?}: off by {off}");
        }
    }
    cases.assert_met(&["a share", "in full", "around the gaze", "as it was"]);
}
