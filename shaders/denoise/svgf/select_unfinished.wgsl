// Lists the pixels that the filter still has to do, and copies all others, whose light is finished or that have none, to the
// other images of the filter.

//!include frame grid projection split pack variance bindings

var<workgroup> listed_here: atomic<u32>;
var<workgroup> first_slot: u32;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if lane == 0u {
        atomicStore(&listed_here, 0u);
    }
    workgroupBarrier();
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    let at = pixel_index(pixel);
    var is_listed = false;
    var slot = 0u;
    if !is_outside(pixel) {
        let has_surface = guide_image[at].w != NO_NORMAL;
        is_listed = has_surface && unpack_light(source[at]).a.x != FINISHED;
        if is_listed {
            slot = atomicAdd(&listed_here, 1u);
        } else {
            let light = select(vec4<u32>(0u), source[at], has_surface);
            filtered[at] = light;
            history[at] = light;
        }
    }
    workgroupBarrier();
    if lane == 0u {
        let count = atomicLoad(&listed_here);
        first_slot = atomicAdd(&unfinished[0], count);
        atomicMax(&unfinished[1], min((first_slot + count + UNFINISHED_GROUP - 1u) / UNFINISHED_GROUP, 65535u));
    }
    let first = workgroupUniformLoad(&first_slot);
    if is_listed {
        atomicStore(&unfinished[LIST_HEADER + first + slot], at);
    }
}
