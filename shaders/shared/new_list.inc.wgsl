// Appends pixels to the compacted list that the pass binds as `new_list`: their number, the three workgroup counts of the
// indirect dispatch over them, and their indices. Each workgroup of that dispatch runs on `group` pixels.

//!include bindings

// Appends a pixel, for passes that list few.
fn append(at: u32, group: u32) {
    let slot = atomicAdd(&new_list[0], 1u);
    atomicStore(&new_list[LIST_HEADER + slot], at);
    if slot % group == 0u && slot / group < 65535u {
        atomicAdd(&new_list[1], 1u);
    }
}

var<workgroup> listed_here: atomic<u32>;
var<workgroup> first_slot: u32;

// Appends the pixels of those invocations of a workgroup for which `is_listed` is true. All invocations call this.
fn append_together(at: u32, is_listed: bool, lane: u32, group: u32) {
    if lane == 0u {
        atomicStore(&listed_here, 0u);
    }
    workgroupBarrier();
    var slot = 0u;
    if is_listed {
        slot = atomicAdd(&listed_here, 1u);
    }
    workgroupBarrier();
    if lane == 0u {
        let count = atomicLoad(&listed_here);
        first_slot = atomicAdd(&new_list[0], count);
        atomicMax(&new_list[1], min((first_slot + count + group - 1u) / group, 65535u));
    }
    let first = workgroupUniformLoad(&first_slot);
    if is_listed {
        atomicStore(&new_list[LIST_HEADER + first + slot], at);
    }
}
