// Perspective images through an image plane in front of the eye.

//!include frame grid

const IS_POLAR: bool = false;

fn is_outside(pixel: vec2<u32>) -> bool {
    return pixel.x >= pass_.width || pixel.y >= pass_.row_end;
}

fn is_in_square(eye_fovea_rows: f32, row: i32) -> bool {
    return false;
}

fn is_shown(pixel: vec2<u32>) -> bool {
    return true;
}

fn row_length(eye_fovea_rows: f32, row: i32) -> f32 {
    return f32(frame.camera.width);
}

fn rows_around(place: f32, eye_fovea_rows: f32, eye_rows: f32) -> vec2<i32> {
    return vec2<i32>(0, i32(pass_.height));
}

fn goes_around(place: f32, eye_fovea_rows: f32) -> bool {
    return false;
}

fn beside(pixel: vec2<u32>, offset: vec2<i32>) -> Beside {
    let there = vec2<i32>(pixel) + offset;
    let held = clamp(there, vec2<i32>(0, i32(pass_.valid_begin)), vec2<i32>(i32(pass_.width), i32(pass_.valid_end)) - 1);
    return Beside(held, all(held == there));
}

fn column_held(eye_fovea_rows: f32, row: i32, column: i32) -> i32 {
    return clamp(column, 0, i32(frame.camera.width) - 1);
}

fn column_in(row: i32, column: f32, eye_fovea_rows: f32) -> f32 {
    return column;
}

fn point_in(pixel: vec2<f32>, offset: vec2<f32>) -> vec2<f32> {
    return pixel + offset;
}

fn ray_of(view: u32, at: vec2<f32>) -> vec3<f32> {
    return pinhole_ray(view, at, vec2<f32>(f32(pass_.width), f32(pass_.height)));
}

fn pixel_of(p: vec3<f32>, eye: View) -> vec3<f32> {
    return pinhole_point(p - eye.origin, eye, vec2<f32>(f32(pass_.width), f32(pass_.height)));
}

fn traced_point(at: vec2<f32>, size: vec2<f32>) -> vec2<f32> {
    return at;
}

fn traced_index(at: vec2<f32>, size: vec2<f32>) -> u32 {
    let nearest = vec2<u32>(clamp(floor(at), vec2<f32>(0.0), size - 1.0));
    return nearest.y * u32(size.x) + nearest.x;
}

fn density_on_screen(at: vec2<f32>, point: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(1.0);
}
