// How a pixel of the pass's grid becomes a ray, and a point in the scene a pixel again: a pinhole's image, or a
// visual-polar one (see `visual_polar.rs`), whose rows are rings around the gaze and whose columns are directions from it.

override VISUAL_POLAR: bool = false;

const TAU: f32 = 6.2831855;
// Where acuity begins to fall, degrees from the gaze; square degrees within; and what acuity adds up to is a multiple of this.
const FOVEA_DEG: f32 = 5.79;
const FOVEA_AREA: f32 = 105.31813;
const ACUITY_SUM: f32 = 522.90064;

fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * pass_.width + pixel.x;
}

// Columns of a row of an image that an eye sees: rings within the fovea have the fewer, the smaller they are.
fn row_length(eye_fovea_rows: f32, row: i32) -> f32 {
    let width = f32(frame.camera.width);
    if VISUAL_POLAR {
        return clamp(ceil(width * (f32(row) + 0.5) / eye_fovea_rows), 1.0, width);
    }
    return width;
}

// Whether a dispatch over pixels has nothing to do here.
fn is_outside(pixel: vec2<u32>) -> bool {
    if VISUAL_POLAR {
        let rows = frame.camera.views[pass_.view].rows;
        let length = row_length(frame.camera.views[pass_.view].fovea_rows, i32(pixel.y));
        return f32(pixel.x) >= length || f32(pixel.y) >= rows || pixel.y >= pass_.row_end;
    }
    return pixel.x >= pass_.width || pixel.y >= pass_.row_end;
}

// A pixel of the same image, at an offset from another: the nearest that may be read, and whether that is it.
struct Beside {
    pixel: vec2<i32>,
    is_there: bool,
}

fn beside(pixel: vec2<u32>, offset: vec2<i32>) -> Beside {
    let there = vec2<i32>(pixel) + offset;
    if VISUAL_POLAR {
        let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
        let end = min(i32(pass_.valid_end), i32(frame.camera.views[pass_.view].rows));
        let row = clamp(there.y, i32(pass_.valid_begin), end - 1);
        let width = i32(frame.camera.width);
        var column = around_ring(there.x, width);
        if f32(min(row, i32(pixel.y))) < fovea_rows {
            // The same direction in a ring of another length.
            let length = row_length(fovea_rows, row);
            let scaled = (f32(there.x) + 0.5) * length / row_length(fovea_rows, i32(pixel.y));
            column = around_ring(i32(floor(scaled - length * floor(scaled / length))), i32(length));
        }
        return Beside(vec2<i32>(column, row), row == there.y);
    }
    let held = clamp(there, vec2<i32>(0, i32(pass_.valid_begin)), vec2<i32>(i32(pass_.width), i32(pass_.valid_end)) - 1);
    return Beside(held, all(held == there));
}

// A column of a ring of this length, which has no ends, from less than a turn beside it.
fn around_ring(column: i32, length: i32) -> i32 {
    let turned = column + select(0, length, column < 0) - select(0, length, column >= length);
    return clamp(turned, 0, length - 1);
}

// Image points, as `pixel_of` finds them, have columns of rows of full length. Where in a row of another length that is.
fn column_in(row: i32, column: f32, eye_fovea_rows: f32) -> f32 {
    if VISUAL_POLAR {
        return column * row_length(eye_fovea_rows, row) / f32(frame.camera.width);
    }
    return column;
}

// The image point at `offset` in a pixel.
fn point_in(pixel: vec2<f32>, offset: vec2<f32>) -> vec2<f32> {
    let at = pixel + offset;
    if VISUAL_POLAR {
        let length = row_length(frame.camera.views[pass_.view].fovea_rows, i32(pixel.y));
        return vec2<f32>(at.x * f32(frame.camera.width) / length, at.y);
    }
    return at;
}

fn acuity_part(degrees: f32) -> f32 {
    let falling = 0.3 * degrees + 1.0;
    return 1.0 / falling + log(falling);
}

// Rings up to an eccentricity outside the fovea: as acuity sums up.
fn rows_within(degrees: f32, fovea_rows: f32) -> f32 {
    let more = ACUITY_SUM * (acuity_part(degrees) - acuity_part(FOVEA_DEG));
    return fovea_rows * (1.0 + more / (2.0 * FOVEA_AREA));
}

fn row_of(degrees: f32, fovea_rows: f32) -> f32 {
    return select(rows_within(degrees, fovea_rows), fovea_rows * degrees / FOVEA_DEG, degrees < FOVEA_DEG);
}

// The eccentricity of a place in the rows, degrees: outside the fovea the paper's fit of the inverse, off by 0.03 at most.
fn eccentricity_near(row: f32, fovea_rows: f32) -> f32 {
    let p = FOVEA_AREA / 1091.3 * (2.0 * row / fovea_rows - 1.0);
    let fit = (((25.09 * p + 0.168) * p + 27.61) * p + 23.87) * p + 3.232;
    return select(fit, FOVEA_DEG * row / fovea_rows, row < fovea_rows);
}

// ... and as exact as can be, by Newton's method from there.
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

// Unit direction through an image point of a pinhole with so many columns and rows, from the top left corner.
fn pinhole_ray(view: u32, at: vec2<f32>, size: vec2<f32>) -> vec3<f32> {
    let ndc = vec2<f32>(2.0, -2.0) * (at / size) + vec2<f32>(-1.0, 1.0);
    return normalize(frame.camera.views[view].forward
        + frame.camera.views[view].right * (ndc.x * frame.camera.views[view].tan_half_x)
        + frame.camera.views[view].up * (ndc.y * frame.camera.views[view].tan_half_y));
}

// Unit direction through the place `at` in a pixel's row: pixels of that row, and rows.
fn ray_of(view: u32, at: vec2<f32>) -> vec3<f32> {
    if VISUAL_POLAR {
        let fovea_rows = frame.camera.views[view].fovea_rows;
        let turn = TAU * at.x / row_length(fovea_rows, i32(at.y));
        let e = radians(eccentricity_at(at.y, fovea_rows));
        let gaze = frame.camera.views[view].gaze;
        let right = frame.camera.views[view].gaze_right;
        return normalize(gaze * cos(e) + (right * cos(turn) + cross(right, gaze) * sin(turn)) * sin(e));
    }
    return pinhole_ray(view, at, vec2<f32>(f32(pass_.width), f32(pass_.height)));
}

// Pixels of a visual-polar image per radian away from the gaze, and around it at a ring of `degrees`.
fn rows_per_radian(degrees: f32, fovea_rows: f32) -> f32 {
    let falling = 0.3 * degrees + 1.0;
    let per_degree = 0.09 * ACUITY_SUM * degrees / (falling * falling * 2.0 * FOVEA_AREA);
    return 57.29578 * fovea_rows * select(per_degree, 1.0 / FOVEA_DEG, degrees < FOVEA_DEG);
}

fn columns_per_radian(row: u32, degrees: f32, fovea_rows: f32) -> f32 {
    return row_length(fovea_rows, i32(row)) / (TAU * max(sin(radians(degrees)), 1e-6));
}

// The point of a visual-polar image in a direction from its eye.
fn polar_point(direction: vec3<f32>, eye: View) -> vec2<f32> {
    let away = vec2<f32>(dot(direction, eye.gaze_right), dot(direction, cross(eye.gaze_right, eye.gaze)));
    let off = length(away);
    let turn = atan2(away.y, away.x);
    let column = f32(frame.camera.width) * (turn + select(0.0, TAU, turn < 0.0)) / TAU;
    let row = row_of(degrees(atan2(off, dot(direction, eye.gaze))), eye.fovea_rows);
    return vec2<f32>(select(0.0, column, off > 0.0), row);
}

// The point of a pinhole's image that lies at `v` from its eye, and how far along its view direction.
fn pinhole_point(v: vec3<f32>, eye: View, size: vec2<f32>) -> vec3<f32> {
    let z = dot(v, eye.forward);
    let front = max(z, 1e-20);
    let ndc = vec2<f32>(
        dot(v, eye.right) / (front * eye.tan_half_x),
        -dot(v, eye.up) / (front * eye.tan_half_y),
    );
    return vec3<f32>((ndc * 0.5 + 0.5) * size, z);
}

// Where an eye sees `p`: image point, and distance along its view direction, or of visual-polar images from the eye.
fn pixel_of(p: vec3<f32>, eye: View) -> vec3<f32> {
    let v = p - eye.origin;
    if VISUAL_POLAR {
        return vec3<f32>(polar_point(v, eye), length(v));
    }
    return pinhole_point(v, eye, vec2<f32>(f32(pass_.width), f32(pass_.height)));
}
