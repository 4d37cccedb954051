// Multiplies by albedo (remodulation), adds emission, and encodes for display: c / (1 + c), then sRGB.

//!include frame grid projection pack display

@group(1) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read> albedo: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> emission: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> linear: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read_write> display: array<u32>;
@group(1) @binding(5) var<storage, read_write> tally: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    var color = radiance[at].rgb * albedo[at].rgb + emission[at].rgb;
    if !is_finite(color) {
        color = vec3<f32>(0.0);
        tally[at] = add_tally(tally[at], 0u, 1u);
    }
    linear[at] = vec4<f32>(color, 1.0);
    display[at] = display_code(color);
}
