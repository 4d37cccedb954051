// Multiplies filtered illumination by albedo (remodulation) and adds emission. The result is the input of temporal
// antialiasing, the stage `resolve`.

//!include frame grid projection split pack bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let color = remodulated(unpack_light(radiance[at]), unpack_albedo(albedo_image[at])) + emission_image[at].rgb;
    // Pass the depth on in alpha, since temporal antialiasing derives a pixel's motion from it.
    composed[at] = select(vec4<f32>(0.0, 0.0, 0.0, DROPPED), vec4<f32>(color, emission_image[at].a), is_finite(color));
}
