// Writes the number of frames in the history of each pixel of the right eye. Pixels that took over the left eye's filtered
// light (see `reproject_filtered.wgsl`) take over its counts too: the mean over the same taps, rounded. All others have
// the right eye's own count.

//!include frame grid projection split pack foveation variance reprojection bindings

// Returns the mean count of the left pixels that show the surface of a right pixel.
fn left_count(pixel: vec2<u32>, hit: vec4<u32>, guide: vec4<u32>) -> f32 {
    var slack = 1.0;
    if FOVEATED {
        slack = f32(1u << layer_of(pixel, 1u));
    }
    let wanted = wanted_by(pixel, hit, guide, slack);
    let seen = pixel_of(wanted.image, frame.camera.views[0]);
    var sum = 0.0;
    var weight = 0.0;
    for (var i = 0; i < taps(); i += 1) {
        let tap = tap_around(seen.xy, pixel.y, i);
        if tap.weight > 0.0 && surface_differs(tap, wanted) == 0u {
            sum += f32(left_counts[tap.at].w >> 24u) * tap.weight;
            weight += tap.weight;
        }
    }
    return round(sum / max(weight, 1e-20));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    var count = f32(counts[at].w >> 24u);
    let guide = guide_image[at];
    if guide.w != NO_NORMAL && unpack_light(filtered[at]).a.x == FINISHED {
        count = left_count(pixel, hit_image[at], guide);
    }
    aov[at] = vec4<f32>(vec3<f32>(count), 1.0);
}
