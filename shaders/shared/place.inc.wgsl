// Pixels of a pass that runs on all pixels of its rows, or on those of the compacted list that it binds as `listed`.

//!include frame grid projection bindings

struct Place {
    pixel: vec2<u32>,
    is_there: bool,
}

// The pixel of an invocation: number `lane` of `lanes` in its workgroup, which is number `group` of `groups`.
fn place_of(id: vec3<u32>, group: u32, groups: u32, lane: u32, lanes: u32) -> Place {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pass_.args.list_part == 0u {
        return Place(pixel, !is_outside(pixel));
    }
    let i = ((pass_.args.list_part - 1u) * groups + group) * lanes + lane;
    let is_listed = i < listed[0];
    let at = listed[LIST_HEADER + select(0u, i, is_listed)];
    let place = vec2<u32>(at % pass_.width, at / pass_.width);
    // Each of several dispatches handles the pixels of its own rows.
    return Place(place, is_listed && place.y >= pass_.row_begin && place.y < pass_.row_end);
}
