// Late reprojection: resamples a rectified image for display by an eye that has moved since the image was rendered.

//!include frame grid projection display display_resampling late_reprojection resampled

@group(1) @binding(0) var<storage, read> rectified: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> linear: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> display: array<u32>;
@group(1) @binding(3) var<storage, read> emission_image: array<vec4<f32>>;

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
