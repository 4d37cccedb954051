// Log-polar images (Andersson & Hansson 2020). The rows of a square of screen pixels around the gaze may precede the
// rings.

//!include frame grid

fn is_in_square(eye_fovea_rows: f32, row: i32) -> bool {
    return f32(row) < eye_fovea_rows;
}

fn row_length(eye_fovea_rows: f32, row: i32) -> f32 {
    let length = select(projection.columns, eye_fovea_rows, is_in_square(eye_fovea_rows, row));
    // The clamp changes no value. Without it, Mesa's software driver rounds image points differently.
    return clamp(length, 1.0, f32(frame.camera.width));
}

// The square and the rings are separate parts of the image: filters and look-ups in one do not read the other.
fn rows_around(place: f32, eye_fovea_rows: f32, eye_rows: f32) -> vec2<i32> {
    let rim = i32(eye_fovea_rows);
    return select(vec2<i32>(rim, i32(eye_rows)), vec2<i32>(0, rim), place < eye_fovea_rows);
}

fn goes_around(place: f32, eye_fovea_rows: f32) -> bool {
    return !(place < eye_fovea_rows);
}

fn column_beside(column: i32, from_row: i32, row: i32, fovea_rows: f32) -> i32 {
    return column;
}

// Position of the gaze on the screen, pixels.
fn gaze_on_screen(view: u32) -> vec2<f32> {
    return vec2<f32>(frame.camera.views[view].gaze_x, frame.camera.views[view].gaze_y);
}

// Distance from the gaze, in screen pixels, of a row position among the rings.
fn distance_at(row: f32, fovea_rows: f32) -> f32 {
    let map = projection;
    let share = max(row - fovea_rows + map.first_ring, 0.0) / map.rings;
    return exp(map.log_diagonal * pow(share, 1.0 / map.kernel));
}

// Columns and rows per screen pixel, at this distance from the gaze (at least 1 pixel).
fn log_polar_density(distance: f32) -> vec2<f32> {
    let map = projection;
    let share = max(log(distance) / map.log_diagonal, 1e-6);
    let rows = map.rings * map.kernel * pow(share, map.kernel - 1.0) / (map.log_diagonal * distance);
    return vec2<f32>(map.columns / (TAU * distance), rows);
}

fn density_on_screen(at: vec2<f32>, point: vec2<f32>) -> vec2<f32> {
    return log_polar_density(max(distance(at, gaze_on_screen(pass_.view)), 1.0));
}

// Screen point that the image shows at the point `at`, whose column counts in columns of its own row.
fn log_polar_on_screen(view: u32, at: vec2<f32>) -> vec2<f32> {
    let gaze = gaze_on_screen(view);
    let fovea_rows = frame.camera.views[view].fovea_rows;
    if at.y < fovea_rows {
        return floor(gaze) - 0.5 * fovea_rows + at;
    }
    let turn = TAU * at.x / projection.columns;
    return gaze + distance_at(at.y, fovea_rows) * vec2<f32>(cos(turn), sin(turn));
}

// Image point that shows a screen point.
fn log_polar_point(at: vec2<f32>, eye: View) -> vec2<f32> {
    let map = projection;
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

fn is_shown(pixel: vec2<u32>) -> bool {
    let map = projection;
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

fn ray_of(view: u32, at: vec2<f32>) -> vec3<f32> {
    return pinhole_ray(view, log_polar_on_screen(view, at), projection.screen);
}

fn traced_point(at: vec2<f32>, size: vec2<f32>) -> vec2<f32> {
    return log_polar_point(at, frame.camera.views[pass_.view]);
}

fn pixel_of(p: vec3<f32>, eye: View) -> vec3<f32> {
    let seen = pinhole_point(p - eye.origin, eye, projection.screen);
    return vec3<f32>(log_polar_point(seen.xy, eye), seen.z);
}
