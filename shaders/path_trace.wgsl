// Path traces the light reflected by the first surfaces of one view: for all pixels in the dispatch's rows, or for
// those that an earlier pass has listed. The compacted list keeps all lanes busy, which avoids the divergence that
// Leria et al. name as the limit of their hole filling. Both cases share one pipeline, since drivers take seconds to
// compile it.

//!include frame grid projection place pixel bindings

// No loop surrounds the paths: inside one, Mesa 22 took five to eight times as long.

@compute @workgroup_size(8, 4)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let place = place_of(id, group.x, groups.x, lane, LIST_GROUP);
    if place.is_there {
        if is_shown(place.pixel) {
            sample_pixel(place.pixel, pass_.view);
        } else {
            radiance_image[pixel_index(place.pixel)] = vec4<u32>(0u);
        }
    }
}
