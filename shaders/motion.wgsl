// Previous position and normal of the surface at each pixel's centre, in the format of the `guide` image. For a surface
// that is seen in mirrors or behind glass, the plane and the image point (see `mirrored.inc.wgsl`). If the surface or one
// of the mirrors has moved, the pixel's ray is traced again to find the point. If the point is unknown, the surface gets
// the opposite normal, which no surface of the previous frame has.

//!include frame grid projection rng pack last_surface mirror_motion mirrored first_surface bindings

// Where the previous frame saw a mirrored surface, in the format of `last_image`.
fn traced_again(pixel: vec2<u32>, image: vec3<f32>, position: vec3<f32>, last: vec3<f32>) -> vec4<f32> {
    let ray = ray_of(pass_.view, vec2<f32>(pixel) + frame.camera.centre);
    let rng = rng_for(pixel, pass_.view, 0u);
    shown_surface(pass_.view, primary_hit(pass_.view, ray, rng), ray, rng, 1u);
    return last_image(mirror_motion, image, ray, position, last);
}

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
        let is_seen_in_mirrors = is_mirrored(hit);
        var bary = bitcast<vec2<f32>>(hit.yz);
        if HAS_MIRRORS {
            bary = select(bary, mirrored_bary(hit), is_seen_in_mirrors);
        }
        let position = bitcast<vec3<f32>>(guide.xyz);
        let last = last_surface(hit.x, bary, position, unpack_normal(guide.w));
        value = select(value, vec4<u32>(bitcast<vec3<u32>>(last.position), pack_normal(last.normal)), last.has_moved);
        if HAS_MIRRORS {
            value.w &= ~SEEN_MIRRORED;
            if is_seen_in_mirrors {
                var image = vec4<f32>(image_point(pass_.view, pixel, hit, position), 1.0);
                if last.has_moved || have_mirrors_moved(hit) {
                    image = traced_again(pixel, image.xyz, position, last.position);
                }
                let normal = select(last.normal, -last.normal, image.w == 0.0);
                value = pack_mirrored_last(pass_.view, last.position, normal, image.xyz);
            }
        }
    }
    last_surface_image[at] = value;
}
