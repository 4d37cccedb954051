// Mask compaction: lists the pixels of a view that are path traced, if a sampling mask leaves the others to the filter
// (Peres, section 4.2, the coordinates buffer). Departure: Peres computes mask and list once on the CPU, for a fixed
// gaze. Here the gaze moves with every frame, so each device lists the pixels of its own rows, without waiting for the
// host. Pixels that are not listed get radiance with alpha 0, by which the filter knows that they were not sampled.

//!include frame grid projection pack foveation new_list bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    let at = pixel_index(pixel);
    var wanted = false;
    if !is_outside(pixel) {
        // Filters do not fill a pixel without a surface at its centre, so pixels at the rim of a surface are traced.
        let is_rim = guide_image[at].w == NO_NORMAL && (hit_image[at].w & FLAG_MIXED) != 0u;
        wanted = is_rim || is_sampled(pixel, pass_.view);
        radiance_image[at] = vec4<u32>(0u);
        if !wanted {
            tally_image[at] |= SKIPPED << 28u;
        }
    }
    append_together(at, wanted, lane, LIST_GROUP);
}
