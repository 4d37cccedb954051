// Maps pixels of the pass's grid to rays, and points in the scene back to pixels. The image is a pinhole's, or a polar
// one (see `stages/polar.rs`), whose rows are rings around the gaze and whose columns are directions from it.

override POLAR: bool = false;
// Whether polar images are log-polar rather than visual-polar. In log-polar images, the rows of a square of screen
// pixels around the gaze may precede the rings.
override LOG_POLAR: bool = false;

const TAU: f32 = 6.2831855;
// Eccentricity at which acuity begins to fall, degrees; area within, square degrees; and factor of the integral of
// acuity.
const FOVEA_DEG: f32 = 5.79;
const FOVEA_AREA: f32 = 105.31813;
const ACUITY_SUM: f32 = 522.90064;
// Maximum fraction of a visual-polar image's rings that are shortened.
const MOST_SHORT: f32 = 0.5;

fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * pass_.width + pixel.x;
}

// Whether a row belongs to the square around the gaze.
fn is_in_square(eye_fovea_rows: f32, row: i32) -> bool {
    return LOG_POLAR && f32(row) < eye_fovea_rows;
}

// Columns of a row of an eye's image. Within the fovea, smaller rings have fewer columns. If the fovea covers most of
// the image, its outer rings still have all columns.
fn row_length(eye_fovea_rows: f32, row: i32) -> f32 {
    let width = f32(frame.camera.width);
    if LOG_POLAR {
        return select(frame.camera.log_polar.columns, eye_fovea_rows, is_in_square(eye_fovea_rows, row));
    }
    if POLAR {
        let short_rows = min(eye_fovea_rows, MOST_SHORT * f32(frame.camera.height));
        return clamp(ceil(width * (f32(row) + 0.5) / short_rows), 1.0, width);
    }
    return width;
}

// Whether a pixel is outside the image or the dispatch's rows.
fn is_outside(pixel: vec2<u32>) -> bool {
    if POLAR {
        let rows = frame.camera.views[pass_.view].rows;
        let length = row_length(frame.camera.views[pass_.view].fovea_rows, i32(pixel.y));
        return f32(pixel.x) >= length || f32(pixel.y) >= rows || pixel.y >= pass_.row_end;
    }
    return pixel.x >= pass_.width || pixel.y >= pass_.row_end;
}

// Pixel at an offset from another one: the nearest that may be read, and whether it is the requested one.
struct Beside {
    pixel: vec2<i32>,
    is_there: bool,
}

fn beside(pixel: vec2<u32>, offset: vec2<i32>) -> Beside {
    let there = vec2<i32>(pixel) + offset;
    if POLAR {
        let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
        let rows = rows_around(f32(pixel.y), fovea_rows, frame.camera.views[pass_.view].rows);
        let row = clamp(there.y, max(i32(pass_.valid_begin), rows.x), min(i32(pass_.valid_end), rows.y) - 1);
        if is_in_square(fovea_rows, row) {
            let column = column_held(fovea_rows, row, there.x);
            return Beside(vec2<i32>(column, row), row == there.y && column == there.x);
        }
        var column = column_held(fovea_rows, row, there.x);
        if !LOG_POLAR && f32(min(row, i32(pixel.y))) < fovea_rows {
            // Map to the same direction in a ring of another length.
            let length = row_length(fovea_rows, row);
            let scaled = (f32(there.x) + 0.5) * length / row_length(fovea_rows, i32(pixel.y));
            column = column_held(fovea_rows, row, i32(floor(scaled - length * floor(scaled / length))));
        }
        return Beside(vec2<i32>(column, row), row == there.y);
    }
    let held = clamp(there, vec2<i32>(0, i32(pass_.valid_begin)), vec2<i32>(i32(pass_.width), i32(pass_.valid_end)) - 1);
    return Beside(held, all(held == there));
}

// Wraps a column around its ring, by at most one turn. Columns of the square are clamped.
fn column_held(eye_fovea_rows: f32, row: i32, column: i32) -> i32 {
    let length = i32(row_length(eye_fovea_rows, row));
    let turn = select(length, 0, is_in_square(eye_fovea_rows, row));
    let turned = column + select(0, turn, column < 0) - select(0, turn, column >= length);
    return clamp(turned, 0, length - 1);
}

// Range of rows that continue the image at a place in it: the first, and the one after the last. The square and the
// rings are separate images.
fn rows_around(place: f32, eye_fovea_rows: f32, eye_rows: f32) -> vec2<i32> {
    if LOG_POLAR {
        let rim = i32(eye_fovea_rows);
        return select(vec2<i32>(rim, i32(eye_rows)), vec2<i32>(0, rim), place < eye_fovea_rows);
    }
    return vec2<i32>(0, select(i32(pass_.height), i32(eye_rows), POLAR));
}

// Converts the column of an image point (see `pixel_of`) to a row's own columns: image points count columns of
// full-length rows.
fn column_in(row: i32, column: f32, eye_fovea_rows: f32) -> f32 {
    if POLAR && !is_in_square(eye_fovea_rows, row) {
        return column * row_length(eye_fovea_rows, row) / f32(frame.camera.width);
    }
    return column;
}

// Image point at `offset` in a pixel.
fn point_in(pixel: vec2<f32>, offset: vec2<f32>) -> vec2<f32> {
    let at = pixel + offset;
    let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
    if POLAR && !is_in_square(fovea_rows, i32(pixel.y)) {
        let length = row_length(fovea_rows, i32(pixel.y));
        return vec2<f32>(at.x * f32(frame.camera.width) / length, at.y);
    }
    return at;
}

fn acuity_part(degrees: f32) -> f32 {
    let falling = 0.3 * degrees + 1.0;
    return 1.0 / falling + log(falling);
}

// Number of rings up to an eccentricity outside the fovea, from the integral of acuity.
fn rows_within(degrees: f32, fovea_rows: f32) -> f32 {
    let more = ACUITY_SUM * (acuity_part(degrees) - acuity_part(FOVEA_DEG));
    return fovea_rows * (1.0 + more / (2.0 * FOVEA_AREA));
}

fn row_of(degrees: f32, fovea_rows: f32) -> f32 {
    return select(rows_within(degrees, fovea_rows), fovea_rows * degrees / FOVEA_DEG, degrees < FOVEA_DEG);
}

// Eccentricity at a place in the rows, degrees. Outside the fovea this is the paper's fit of the inverse, with an error
// of at most 0.03.
fn eccentricity_near(row: f32, fovea_rows: f32) -> f32 {
    let p = FOVEA_AREA / 1091.3 * (2.0 * row / fovea_rows - 1.0);
    let fit = (((25.09 * p + 0.168) * p + 27.61) * p + 23.87) * p + 3.232;
    return select(fit, FOVEA_DEG * row / fovea_rows, row < fovea_rows);
}

// Eccentricity at a place in the rows, degrees, refined by Newton's method.
fn eccentricity_at(row: f32, fovea_rows: f32) -> f32 {
    var degrees = eccentricity_near(row, fovea_rows);
    if row < fovea_rows {
        return degrees;
    }
    let sum = FOVEA_AREA * (2.0 * row / fovea_rows - 1.0);
    for (var i = 0; i < 2; i += 1) {
        let falling = 0.3 * degrees + 1.0;
        let off = FOVEA_AREA + ACUITY_SUM * (acuity_part(degrees) - acuity_part(FOVEA_DEG)) - sum;
        degrees -= off * falling * falling / (0.09 * ACUITY_SUM * degrees);
    }
    return degrees;
}

// Unit direction through a point of a pinhole image of this size, measured from the top left corner.
fn pinhole_ray(view: u32, at: vec2<f32>, size: vec2<f32>) -> vec3<f32> {
    let ndc = vec2<f32>(2.0, -2.0) * (at / size) + vec2<f32>(-1.0, 1.0);
    return normalize(frame.camera.views[view].forward
        + frame.camera.views[view].right * (ndc.x * frame.camera.views[view].tan_half_x)
        + frame.camera.views[view].up * (ndc.y * frame.camera.views[view].tan_half_y));
}

// Position of the gaze on the screen, pixels; only for log-polar images.
fn gaze_on_screen(view: u32) -> vec2<f32> {
    return vec2<f32>(frame.camera.views[view].gaze_x, frame.camera.views[view].gaze_y);
}

// Distance from the gaze, in screen pixels, of a place among the rings of a log-polar image.
fn distance_at(row: f32, fovea_rows: f32) -> f32 {
    let map = frame.camera.log_polar;
    let share = max(row - fovea_rows + map.first_ring, 0.0) / map.rings;
    return exp(map.log_diagonal * pow(share, 1.0 / map.kernel));
}

// Columns and rows of a log-polar image per screen pixel, at this distance from the gaze (at least 1 pixel).
fn log_polar_density(distance: f32) -> vec2<f32> {
    let map = frame.camera.log_polar;
    let share = max(log(distance) / map.log_diagonal, 1e-6);
    let rows = map.rings * map.kernel * pow(share, map.kernel - 1.0) / (map.log_diagonal * distance);
    return vec2<f32>(map.columns / (TAU * distance), rows);
}

// Screen point that a place in a log-polar image shows. The place is in columns of its own row, and rows.
fn log_polar_on_screen(view: u32, at: vec2<f32>) -> vec2<f32> {
    let gaze = gaze_on_screen(view);
    let fovea_rows = frame.camera.views[view].fovea_rows;
    if at.y < fovea_rows {
        return floor(gaze) - 0.5 * fovea_rows + at;
    }
    let turn = TAU * at.x / frame.camera.log_polar.columns;
    return gaze + distance_at(at.y, fovea_rows) * vec2<f32>(cos(turn), sin(turn));
}

// Log-polar image point that shows a screen point.
fn log_polar_point(at: vec2<f32>, eye: View) -> vec2<f32> {
    let map = frame.camera.log_polar;
    let gaze = vec2<f32>(eye.gaze_x, eye.gaze_y);
    let away = at - gaze;
    let distance = length(away);
    if distance < map.radius {
        return at - floor(gaze) + 0.5 * eye.fovea_rows;
    }
    let turn = atan2(away.y, away.x);
    let column = f32(frame.camera.width) * (turn + select(0.0, TAU, turn < 0.0)) / TAU;
    let ring = map.rings * pow(log(max(distance, 1.0)) / map.log_diagonal, map.kernel) - map.first_ring;
    return vec2<f32>(column, eye.fovea_rows + max(ring, 0.0));
}

// Whether a pixel is on the screen, or so close to it that filters read it. Other pixels are not traced.
fn is_shown(pixel: vec2<u32>) -> bool {
    if !LOG_POLAR {
        return true;
    }
    let map = frame.camera.log_polar;
    let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
    let at = log_polar_on_screen(pass_.view, vec2<f32>(pixel) + 0.5);
    var margin = 1.0;
    var is_on_disc = true;
    if is_in_square(fovea_rows, i32(pixel.y)) {
        is_on_disc = distance(at, gaze_on_screen(pass_.view)) < map.radius + 1.0;
    } else {
        let density = log_polar_density(max(distance_at(f32(pixel.y) + 0.5, fovea_rows), 1.0));
        margin = 2.5 / max(min(density.x, density.y), 1e-6);
    }
    return is_on_disc && all(at > vec2<f32>(-margin)) && all(at < map.screen + margin);
}

// Unit direction through the place `at`, which is in columns of its own row, and rows.
fn ray_of(view: u32, at: vec2<f32>) -> vec3<f32> {
    if LOG_POLAR {
        return pinhole_ray(view, log_polar_on_screen(view, at), frame.camera.log_polar.screen);
    }
    if POLAR {
        let fovea_rows = frame.camera.views[view].fovea_rows;
        let turn = TAU * at.x / row_length(fovea_rows, i32(at.y));
        let e = radians(eccentricity_at(at.y, fovea_rows));
        let gaze = frame.camera.views[view].gaze;
        let right = frame.camera.views[view].gaze_right;
        return normalize(gaze * cos(e) + (right * cos(turn) + cross(right, gaze) * sin(turn)) * sin(e));
    }
    return pinhole_ray(view, at, vec2<f32>(f32(pass_.width), f32(pass_.height)));
}

// Pixels of a visual-polar image per radian at a ring of `degrees`: away from the gaze, and then around it.
fn rows_per_radian(degrees: f32, fovea_rows: f32) -> f32 {
    let falling = 0.3 * degrees + 1.0;
    let per_degree = 0.09 * ACUITY_SUM * degrees / (falling * falling * 2.0 * FOVEA_AREA);
    return 57.29578 * fovea_rows * select(per_degree, 1.0 / FOVEA_DEG, degrees < FOVEA_DEG);
}

fn columns_per_radian(row: u32, degrees: f32, fovea_rows: f32) -> f32 {
    return row_length(fovea_rows, i32(row)) / (TAU * max(sin(radians(degrees)), 1e-6));
}

// Visual-polar image point in a direction from its eye.
fn visual_polar_point(direction: vec3<f32>, eye: View) -> vec2<f32> {
    let away = vec2<f32>(dot(direction, eye.gaze_right), dot(direction, cross(eye.gaze_right, eye.gaze)));
    let off = length(away);
    let turn = atan2(away.y, away.x);
    let column = f32(frame.camera.width) * (turn + select(0.0, TAU, turn < 0.0)) / TAU;
    let row = row_of(degrees(atan2(off, dot(direction, eye.gaze))), eye.fovea_rows);
    return vec2<f32>(select(0.0, column, off > 0.0), row);
}

// Pinhole image point at `v` from its eye, and the distance along the view direction.
fn pinhole_point(v: vec3<f32>, eye: View, size: vec2<f32>) -> vec3<f32> {
    let z = dot(v, eye.forward);
    let front = max(z, 1e-20);
    let ndc = vec2<f32>(
        dot(v, eye.right) / (front * eye.tan_half_x),
        -dot(v, eye.up) / (front * eye.tan_half_y),
    );
    return vec3<f32>((ndc * 0.5 + 0.5) * size, z);
}

// Polar image point of the pass's view that shows a point of the screen, which has this size.
fn polar_point(at: vec2<f32>, size: vec2<f32>) -> vec2<f32> {
    let eye = frame.camera.views[pass_.view];
    if LOG_POLAR {
        return log_polar_point(at, eye);
    }
    return visual_polar_point(pinhole_ray(pass_.view, at, size), eye);
}

// Index of the polar pixel that shows a point of the screen, or of the nearest one.
fn polar_index(at: vec2<f32>, size: vec2<f32>) -> u32 {
    let eye = frame.camera.views[pass_.view];
    let point = polar_point(at, size);
    let row = clamp(i32(floor(point.y)), 0, i32(eye.rows) - 1);
    let column = column_held(eye.fovea_rows, row, i32(floor(column_in(row, point.x, eye.fovea_rows))));
    return u32(row) * frame.camera.width + u32(column);
}

// Image point where an eye sees `p`, and the distance along its view direction (from the eye in visual-polar images).
fn pixel_of(p: vec3<f32>, eye: View) -> vec3<f32> {
    let v = p - eye.origin;
    if LOG_POLAR {
        let seen = pinhole_point(v, eye, frame.camera.log_polar.screen);
        return vec3<f32>(log_polar_point(seen.xy, eye), seen.z);
    }
    if POLAR {
        return vec3<f32>(visual_polar_point(v, eye), length(v));
    }
    return pinhole_point(v, eye, vec2<f32>(f32(pass_.width), f32(pass_.height)));
}
