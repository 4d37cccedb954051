// Display resampling of an auxiliary image: each displayed pixel takes the value of the nearest rectified pixel.

//!include frame display_resampling bindings

// Point of the displayed image that shows a point of the rectified one.
fn shown_point(point: vec2<f32>) -> vec2<f32> {
    let shown = frame.camera.display_maps[pass_.view];
    let at = vec3<f32>(point, 1.0);
    // Inverse map up to the determinant, which cancels in the division.
    let scaled = vec3<f32>(
        dot(cross(shown.down, shown.corner), at),
        dot(cross(shown.corner, shown.across), at),
        dot(cross(shown.across, shown.down), at),
    );
    return scaled.xy / scaled.z;
}

// Converts motion in the rectified image to motion in the displayed one.
fn shown_motion(point: vec2<f32>, motion: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(shown_point(point + motion.xy) - shown_point(point), 0.0, motion.a);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    // Outside the displayed image.
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let point = shown_place(vec2<f32>(pixel) + 0.5).point;
    let value = rectified[rectified_index(point)];
    aov[pixel.y * pass_.width + pixel.x] = select(value, shown_motion(point, value), pass_.args.is_motion != 0u);
}
