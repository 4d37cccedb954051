// Previous position and normal of the surface at each pixel's centre, in the format of the `guide` image. A surface that
// is seen in mirrors or behind glass and has moved, or whose mirrors have, was seen somewhere else: it keeps its position
// and gets the opposite normal, which no surface of the previous frame has.

//!include frame grid projection rng scene pack mirrored last_surface bindings

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
        var bary = bitcast<vec2<f32>>(hit.yz);
        if HAS_MIRRORS {
            bary = select(bary, mirrored_bary(hit), is_mirrored(hit));
        }
        let normal = unpack_normal(guide.w);
        let last = last_surface(hit.x, bary, bitcast<vec3<f32>>(guide.xyz), normal);
        value = select(value, vec4<u32>(bitcast<vec3<u32>>(last.position), pack_normal(last.normal)), last.has_moved);
        if HAS_MIRRORS {
            let is_lost = last.has_moved || have_mirrors_moved(hit);
            let mirrored = vec4<u32>(guide.xyz, pack_normal(select(normal, -normal, is_lost)) | SEEN_MIRRORED);
            value = select(vec4<u32>(value.xyz, value.w & ~SEEN_MIRRORED), mirrored, is_mirrored(hit));
        }
    }
    last_surface_image[at] = value;
}
