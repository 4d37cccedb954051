// Late reprojection of an auxiliary image, for an eye that has moved since the image was rendered. Each displayed pixel
// takes the value of the nearest rectified pixel, unchanged.

//!include frame display_resampling late_reprojection bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    // Outside the displayed image.
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    aov[pixel.y * pass_.width + pixel.x] = rectified[rectified_index(later_place(vec2<f32>(pixel) + 0.5).point)];
}
