// Mask compaction: lists the pixels of a view that are path traced, if a sampling mask leaves the others to the filter
// (Peres, section 4.2, the coordinates buffer). Departure: Peres computes mask and list once on the CPU, for a fixed
// gaze. Here the gaze moves with every frame, so each device lists the pixels of its own rows, without waiting for the
// host. Pixels that are not listed get radiance with alpha 0, by which the filter knows that they were not sampled.

//!include frame grid projection pack foveation bindings

var<workgroup> wanted_here: atomic<u32>;
var<workgroup> first_slot: u32;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&wanted_here, 0u);
    }
    workgroupBarrier();
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    let at = pixel_index(pixel);
    var wanted = false;
    var slot = 0u;
    if !is_outside(pixel) {
        // Filters do not fill a pixel without a surface at its centre, so pixels at the rim of a surface are traced.
        let is_rim = guide_image[at].w == NO_NORMAL && (hit_image[at].w & FLAG_MIXED) != 0u;
        wanted = is_rim || is_sampled(pixel, pass_.view);
        radiance_image[at] = vec4<u32>(0u);
        if wanted {
            slot = atomicAdd(&wanted_here, 1u);
        } else {
            tally_image[at] |= SKIPPED << 28u;
        }
    }
    workgroupBarrier();
    if lane == 0u {
        let count = atomicLoad(&wanted_here);
        first_slot = atomicAdd(&holes[0], count);
        atomicMax(&holes[1], min((first_slot + count + LIST_GROUP - 1u) / LIST_GROUP, 65535u));
    }
    let first = workgroupUniformLoad(&first_slot);
    if wanted {
        atomicStore(&holes[LIST_HEADER + first + slot], at);
    }
}
