// Visual-polar images, in which the density of rings follows visual acuity (Koskela et al. 2019).

//!include frame grid

// Eccentricity at which acuity begins to fall, degrees; area of the fovea within it, square degrees; and factor of the
// integral of acuity outside the fovea.
const FOVEA_DEG: f32 = 5.79;
const FOVEA_AREA: f32 = 105.31813;
const ACUITY_SUM: f32 = 522.90064;
// Maximum fraction of an image's rings that have fewer columns than the outermost.
const MOST_SHORT: f32 = 0.5;

fn is_in_square(eye_fovea_rows: f32, row: i32) -> bool {
    return false;
}

fn is_shown(pixel: vec2<u32>) -> bool {
    return true;
}

// Within the fovea, smaller rings have fewer columns. At most MOST_SHORT of the image's rings are shortened, even if
// the fovea has more.
fn row_length(eye_fovea_rows: f32, row: i32) -> f32 {
    let width = f32(frame.camera.width);
    let short_rows = min(eye_fovea_rows, MOST_SHORT * f32(frame.camera.height));
    return clamp(ceil(width * (f32(row) + 0.5) / short_rows), 1.0, width);
}

fn rows_around(place: f32, eye_fovea_rows: f32, eye_rows: f32) -> vec2<i32> {
    return vec2<i32>(0, i32(eye_rows));
}

fn goes_around(place: f32, eye_fovea_rows: f32) -> bool {
    return true;
}

fn column_beside(column: i32, from_row: i32, row: i32, fovea_rows: f32) -> i32 {
    if f32(min(row, from_row)) >= fovea_rows {
        return column;
    }
    // Map to the same direction in a ring of another length.
    let length = row_length(fovea_rows, row);
    let scaled = (f32(column) + 0.5) * length / row_length(fovea_rows, from_row);
    return i32(floor(scaled - length * floor(scaled / length)));
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

// Eccentricity at a row position, degrees. Outside the fovea this is the paper's polynomial fit of the inverse. Its
// error is at most 0.03 degrees up to 41 degrees, and grows beyond.
fn eccentricity_near(row: f32, fovea_rows: f32) -> f32 {
    let p = FOVEA_AREA / 1091.3 * (2.0 * row / fovea_rows - 1.0);
    let fit = (((25.09 * p + 0.168) * p + 27.61) * p + 23.87) * p + 3.232;
    return select(fit, FOVEA_DEG * row / fovea_rows, row < fovea_rows);
}

// Eccentricity at a row position, degrees, refined by Newton's method.
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

// Pixels per radian at an eccentricity of `degrees`: rows away from the gaze and, in the function below, columns around
// it.
fn rows_per_radian(degrees: f32, fovea_rows: f32) -> f32 {
    let falling = 0.3 * degrees + 1.0;
    let per_degree = 0.09 * ACUITY_SUM * degrees / (falling * falling * 2.0 * FOVEA_AREA);
    return 57.29578 * fovea_rows * select(per_degree, 1.0 / FOVEA_DEG, degrees < FOVEA_DEG);
}

fn columns_per_radian(row: u32, degrees: f32, fovea_rows: f32) -> f32 {
    return row_length(fovea_rows, i32(row)) / (TAU * max(sin(radians(degrees)), 1e-6));
}

fn density_on_screen(at: vec2<f32>, point: vec2<f32>) -> vec2<f32> {
    let eye = frame.camera.views[pass_.view];
    let e = eccentricity_near(point.y, eye.fovea_rows);
    // Angle of a screen pixel, which is smaller away from the centre of a pinhole image.
    let ray = pinhole_ray(pass_.view, at, vec2<f32>(f32(pass_.width), f32(pass_.height)));
    let facing = dot(ray, eye.forward);
    let angle = 2.0 * eye.tan_half_y / f32(pass_.height) * facing * sqrt(facing);
    let inner = u32(clamp(point.y, 0.0, eye.rows - 1.0));
    return angle * vec2<f32>(columns_per_radian(inner, e, eye.fovea_rows), rows_per_radian(e, eye.fovea_rows));
}

fn ray_of(view: u32, at: vec2<f32>) -> vec3<f32> {
    let fovea_rows = frame.camera.views[view].fovea_rows;
    let turn = TAU * at.x / row_length(fovea_rows, i32(at.y));
    let e = radians(eccentricity_at(at.y, fovea_rows));
    let gaze = frame.camera.views[view].gaze;
    let right = frame.camera.views[view].gaze_right;
    return normalize(gaze * cos(e) + (right * cos(turn) + cross(right, gaze) * sin(turn)) * sin(e));
}

// Image point that shows what `eye` sees in a direction.
fn visual_polar_point(direction: vec3<f32>, eye: View) -> vec2<f32> {
    let away = vec2<f32>(dot(direction, eye.gaze_right), dot(direction, cross(eye.gaze_right, eye.gaze)));
    let off = length(away);
    let turn = atan2(away.y, away.x);
    let column = f32(frame.camera.width) * (turn + select(0.0, TAU, turn < 0.0)) / TAU;
    let row = row_of(degrees(atan2(off, dot(direction, eye.gaze))), eye.fovea_rows);
    return vec2<f32>(select(0.0, column, off > 0.0), row);
}

fn traced_point(at: vec2<f32>, size: vec2<f32>) -> vec2<f32> {
    return visual_polar_point(pinhole_ray(pass_.view, at, size), frame.camera.views[pass_.view]);
}

fn pixel_of(p: vec3<f32>, eye: View) -> vec3<f32> {
    let v = p - eye.origin;
    return vec3<f32>(visual_polar_point(v, eye), length(v));
}
