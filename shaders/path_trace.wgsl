// Path traces the light reflected by the first surfaces of one view: for all pixels in the dispatch's rows, or for
// those that an earlier pass has listed. The compacted list keeps all lanes busy, which avoids the divergence that
// Leria et al. name as the limit of their hole filling. Both cases share one pipeline, since drivers take seconds to
// compile it.

//!include frame grid projection pixel bindings

// `holes` holds the number of listed pixels, then the three workgroup counts of the indirect dispatch, then the indices
// of the pixels.

@compute @workgroup_size(8, 4)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let listed_only = pass_.args.listed_only != 0u;
    var pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    var i = 0u;
    var end = select(1u, 0u, is_outside(pixel));
    if listed_only {
        i = group.x * LIST_GROUP + lane;
        end = holes[0];
    }
    for (; i < end; i += groups.x * LIST_GROUP) {
        if listed_only {
            let at = holes[LIST_HEADER + i];
            pixel = vec2<u32>(at % pass_.width, at / pass_.width);
            // If the work is split into several dispatches, each handles the listed pixels in its own rows.
            if pixel.y < pass_.row_begin || pixel.y >= pass_.row_end {
                continue;
            }
        }
        if !is_shown(pixel) {
            radiance_image[pixel_index(pixel)] = vec4<u32>(0u);
            continue;
        }
        sample_pixel(pixel, pass_.view);
    }
}
