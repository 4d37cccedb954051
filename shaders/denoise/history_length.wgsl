// Writes the number of frames in the history of each pixel, as the denoiser counted them after its accumulation.

//!include frame grid projection bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    aov[at] = vec4<f32>(vec3<f32>(f32(counts[at].w >> 24u)), 1.0);
}
