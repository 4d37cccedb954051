// Pixels of a filter that runs on all pixels of its rows, or on those that `select_unfinished` has listed.

//!include frame grid projection variance bindings

struct Place {
    pixel: vec2<u32>,
    is_there: bool,
}

// The pixel of an invocation.
fn place_of(id: vec3<u32>, group: u32, groups: u32, lane: u32) -> Place {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pass_.args.list_part == 0u {
        return Place(pixel, !is_outside(pixel));
    }
    let i = ((pass_.args.list_part - 1u) * groups + group) * UNFINISHED_GROUP + lane;
    let is_listed = i < unfinished[0];
    let at = unfinished[LIST_HEADER + select(0u, i, is_listed)];
    let listed = vec2<u32>(at % pass_.width, at / pass_.width);
    // Each of several dispatches handles the pixels of its own rows.
    return Place(listed, is_listed && listed.y >= pass_.row_begin && listed.y < pass_.row_end);
}
