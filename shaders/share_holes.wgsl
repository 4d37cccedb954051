// Holes that several views share: a listed pixel gathers the light that the partner view sampled on its surface (see
// `gather.inc.wgsl`), which was a hole of the partner as well and was path traced there. Pixels whose surface the partner
// does not show either are listed again, for path tracing.

//!include frame grid projection split pack foveation place gather new_list bindings

@compute @workgroup_size(8, 4)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let place = place_of(id, group.x, groups.x, lane, LIST_GROUP);
    if !place.is_there {
        return;
    }
    let pixel = place.pixel;
    let at = pixel_index(pixel);
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
    append(at, LIST_GROUP);
}
