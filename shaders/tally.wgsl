// Sums per-pixel counts over each row. The sums tell the scheduler the work per row, and add up to the run's totals.

//!include frame projection pack bindings

// `row_tally` has COUNTS counters per row: rays, dropped non-finite samples, holes by reason 1 to 6, pixels left to the
// filter, clipped pixels.

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = pass_.row_begin + id.y;
    let first = id.x * SEGMENT;
    if is_outside(vec2<u32>(first, row)) {
        return;
    }
    let length = u32(row_length(frame.camera.views[pass_.view].fovea_rows, i32(row)));
    var counts: array<u32, COUNTS>;
    for (var x = first; x < min(first + SEGMENT, length); x += 1u) {
        let t = tally_image[row * pass_.width + x];
        counts[0] += t & 0xfffffu;
        counts[1] += (t >> 20u) & 0xffu;
        let why = hole_reason(t);
        if why != 0u {
            counts[min(why, SKIPPED) + 1u] += 1u;
        }
        counts[COUNTS - 1u] += select(0u, 1u, (t & CLIPPED) != 0u);
    }
    for (var i = 0u; i < COUNTS; i += 1u) {
        if counts[i] != 0u {
            atomicAdd(&row_tally[row * COUNTS + i], counts[i]);
        }
    }
}
