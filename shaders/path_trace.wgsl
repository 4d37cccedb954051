// Path traces the light reflected by the first surfaces of one view: for all pixels in the dispatch's rows, or for
// those that an earlier pass has listed. The compacted list keeps all lanes busy, which avoids the divergence that
// Leria et al. name as the limit of their hole filling. Both cases share one pipeline, since drivers take seconds to
// compile it.

//!include frame grid projection pixel bindings

// `holes` holds the number of listed pixels, then the three workgroup counts of the indirect dispatch, then the indices
// of the pixels. No loop surrounds the paths: inside one, Mesa 22 took five to eight times as long.

@compute @workgroup_size(8, 4)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    var pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    var is_wanted = !is_outside(pixel);
    if pass_.args.list_part != 0u {
        let i = ((pass_.args.list_part - 1u) * groups.x + group.x) * LIST_GROUP + lane;
        is_wanted = i < holes[0];
        let at = holes[LIST_HEADER + select(0u, i, is_wanted)];
        pixel = vec2<u32>(at % pass_.width, at / pass_.width);
        // If the work is split into several dispatches, each handles the listed pixels in its own rows.
        is_wanted = is_wanted && pixel.y >= pass_.row_begin && pixel.y < pass_.row_end;
    }
    if is_wanted {
        if is_shown(pixel) {
            sample_pixel(pixel, pass_.view);
        } else {
            radiance_image[pixel_index(pixel)] = vec4<u32>(0u);
        }
    }
}
