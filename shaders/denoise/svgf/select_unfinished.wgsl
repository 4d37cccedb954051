// Lists the pixels that the filter still has to do, and copies all others, whose light is finished or that show no surface,
// to the other images of the filter.

//!include frame grid projection split pack variance new_list bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    let at = pixel_index(pixel);
    var is_listed = false;
    if !is_outside(pixel) {
        is_listed = guide_image[at].w != NO_NORMAL && unpack_light(source[at]).a.x != FINISHED;
        if !is_listed {
            filtered[at] = source[at];
            history[at] = source[at];
        }
    }
    append_together(at, is_listed, lane, UNFINISHED_GROUP);
}
