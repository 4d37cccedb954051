// Previous position and normal of the surface at each pixel's centre, in the format of the `guide` image.

//!include frame grid projection rng scene pack last_surface bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let guide = guide_image[at];
    var value = guide;
    if guide.w != NO_NORMAL {
        let hit = hit_image[at];
        let last = last_surface(hit.x, bitcast<vec2<f32>>(hit.yz), bitcast<vec3<f32>>(guide.xyz), unpack_normal(guide.w));
        value = select(value, vec4<u32>(bitcast<vec3<u32>>(last.position), pack_normal(last.normal)), last.has_moved);
    }
    last_surface_image[at] = value;
}
