// Light reflected by the first surfaces of one view.

//!include frame rng scene lights trace surface bsdf path pack pixel

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pixel.x >= frame.width || pixel.y >= pass_.row_end {
        return;
    }
    sample_pixel(pixel, pass_.view);
}
