// Late reprojection: resamples a rectified image for display by an eye that has moved since the image was rendered.

//!include frame display late_reprojection resampled bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    // Outside the displayed image.
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let color = resampled(later_place(vec2<f32>(pixel) + 0.5));
    let at = pixel.y * pass_.width + pixel.x;
    linear[at] = vec4<f32>(color, 1.0);
    display[at] = display_code(color);
}
