// Holes that several views share: a listed pixel gathers the light that the partner view sampled on its surface (see
// `gather.inc.wgsl`), which was a hole of the partner as well and was path traced there. Pixels whose surface the partner
// does not show either are listed again, for path tracing.

//!include frame grid projection split pack foveation gather bindings

@compute @workgroup_size(8, 4)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = ((pass_.args.list_part - 1u) * groups.x + group.x) * LIST_GROUP + lane;
    if i >= holes[0] {
        return;
    }
    let at = holes[LIST_HEADER + i];
    let pixel = vec2<u32>(at % pass_.width, at / pass_.width);
    // If the work is split into several dispatches, each handles the listed pixels in its own rows.
    if pixel.y < pass_.row_begin || pixel.y >= pass_.row_end {
        return;
    }
    let hit = hit_image[at];
    let guide = guide_image[at];
    let is_mixed = !ACCEPTS_MIXED && (hit.w & FLAG_MIXED) != 0u;
    if guide.w != NO_NORMAL && !is_mixed && (hit.w & FLAG_VIEW_DEPENDENT) == 0u {
        let wanted = wanted_by(pixel, hit, guide, 1.0);
        let seen = pixel_of(wanted.image, frame.camera.views[0]);
        if seen.z > 0.0 {
            let found = gathered(seen.xy, pixel.y, wanted);
            if found.sum >= LEAST_SUM {
                radiance_image[at] = pack_gathered(found);
                tally_image[at] &= ~REASON_BITS;
                return;
            }
        }
    }
    let slot = atomicAdd(&unshared[0], 1u);
    atomicStore(&unshared[LIST_HEADER + slot], at);
    if slot % LIST_GROUP == 0u && slot / LIST_GROUP < 65535u {
        atomicAdd(&unshared[1], 1u);
    }
}
