// Blurs a log-polar image along one of its axes: blends each pixel with the two next to it, whose weight grows with the
// distance from the gaze (Andersson & Hansson 2020, section 3.5). Departure: the image is blurred before it is mapped
// to the screen, while it has fewer pixels.

//!include frame grid grid_log_polar grid_polar bindings

// Blends a pixel with its two neighbours. At full blur, the weights are 1/4, 1/2 and 1/4, a Gaussian of three taps.
fn blurred_by_next(pixel: vec2<u32>, along_columns: bool) -> vec3<f32> {
    let map = projection;
    let own = source[pixel_index(pixel)].rgb;
    let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
    let distance = distance_at(f32(pixel.y) + 0.5, fovea_rows);
    let share = clamp((distance - map.blur_begins) / (map.blur_full - map.blur_begins), 0.0, 1.0);
    if is_in_square(fovea_rows, i32(pixel.y)) || map.blur_begins >= map.blur_full || share <= 0.0 {
        return own;
    }
    let step = select(vec2<i32>(0, 1), vec2<i32>(1, 0), along_columns);
    let before = source[pixel_index(vec2<u32>(beside(pixel, -step).pixel))].rgb;
    let after = source[pixel_index(vec2<u32>(beside(pixel, step).pixel))].rgb;
    return own * (1.0 - 0.5 * share) + (before + after) * (0.25 * share);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    blurred[pixel_index(pixel)] = vec4<f32>(blurred_by_next(pixel, pass_.args.axis == 0u), 1.0);
}
