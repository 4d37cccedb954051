// Maps a polar image to the screen: each screen pixel is interpolated linearly between rings and columns, or copied
// from the image's square of screen pixels around the gaze. Departure from Koskela et al. 2019 and Andersson & Hansson
// 2020: near the gaze, where the image is finer than the screen, all polar pixels in a screen pixel's footprint are
// averaged, instead of sampling smaller images with half the columns, or the nearest pixel.

//!include frame projection display bindings

// Maximum footprint: polar pixels between the centres of adjacent screen pixels.
const MOST_FOOTPRINT: f32 = 6.0;

fn gathered(at: vec2<f32>, point: vec2<f32>) -> vec3<f32> {
    let eye = frame.camera.views[pass_.view];
    let columns = i32(frame.camera.width);
    let rows = rows_around(point.y, eye.fovea_rows, eye.rows);
    let reach = clamp(density_on_screen(at, point), vec2<f32>(1.0), vec2<f32>(MOST_FOOTPRINT));
    let y = point.y - 0.5;
    var sum = vec3<f32>(0.0);
    var weight = 0.0;
    for (var row = i32(ceil(y - reach.y)); f32(row) <= y + reach.y; row += 1) {
        // Rows beyond the gaze are on the other side of the innermost ring.
        let is_across = row < 0;
        let there = clamp(select(row, -1 - row, is_across), rows.x, rows.y - 1);
        let turned = point.x + select(0.0, 0.5 * f32(columns), is_across);
        let x = column_in(there, turned, eye.fovea_rows) - 0.5;
        let w = max(1.0 - abs(f32(row) - y) / reach.y, 0.0);
        for (var column = i32(ceil(x - reach.x)); f32(column) <= x + reach.x; column += 1) {
            let k = w * max(1.0 - abs(f32(column) - x) / reach.x, 0.0);
            sum += polar[there * columns + column_held(eye.fovea_rows, there, column)].rgb * k;
            weight += k;
        }
    }
    return sum / max(weight, 1e-20);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    // Outside the screen.
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let centre = vec2<f32>(pixel) + 0.5;
    let point = traced_point(centre, vec2<f32>(f32(pass_.width), f32(pass_.height)));
    var color: vec3<f32>;
    if is_in_square(frame.camera.views[pass_.view].fovea_rows, i32(floor(point.y))) {
        let there = vec2<u32>(floor(point));
        color = polar[there.y * frame.camera.width + there.x].rgb;
    } else {
        color = gathered(centre, point);
    }
    let at = pixel.y * pass_.width + pixel.x;
    linear[at] = vec4<f32>(color, 1.0);
    display[at] = display_code(color);
}
