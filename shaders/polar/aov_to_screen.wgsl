// Maps a polar auxiliary image to the screen: each screen pixel takes the value of the polar pixel in its direction.

//!include frame projection bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    // Outside the screen.
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let size = vec2<f32>(f32(pass_.width), f32(pass_.height));
    aov[pixel.y * pass_.width + pixel.x] = polar[traced_index(vec2<f32>(pixel) + 0.5, size)];
}
