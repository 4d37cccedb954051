// Multiplies by albedo (remodulation), adds emission, and encodes for display: c / (1 + c), then sRGB.

//!include frame grid projection split pack display bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    var color = remodulated(unpack_light(radiance[at]), unpack_albedo(albedo_image[at])) + emission_image[at].rgb;
    if !is_finite(color) {
        color = vec3<f32>(0.0);
        tally_image[at] = add_tally(tally_image[at], 0u, 1u);
    }
    linear[at] = vec4<f32>(color, 1.0);
    display[at] = display_code(color);
}
