// Sums the records of a frame for each slot of the radiance cache, in two launches. Of several new cells with the same
// slot, the one with the largest key gets it, so that the order of the records does not matter; for the same reason,
// light is summed in integers.

//!include frame cells bindings

// A channel of packed light or albedo as a 64-bit integer in RECORD_UNITS: low and high word.
fn record_units(packed: u32, channel: u32) -> vec2<u32> {
    let m = (packed >> (9u * channel)) & 511u;
    let exponent = packed >> 27u;
    return vec2<u32>(m << exponent, (m >> 1u) >> (31u - exponent));
}

fn claim(slot: u32, key: u32) {
    if yields(live_cell(slot)) {
        atomicMax(&cache_sums[SUM_WORDS * slot], key);
    }
}

// Adds a record to the cell that has the slot: a claimed cell or, without one, the cell that is there.
fn add(slot: u32, key: u32, light: u32, albedo: u32) {
    let at = SUM_WORDS * slot;
    let claimed = atomicLoad(&cache_sums[at]);
    if key != select(claimed, live_cell(slot).key, claimed == NO_CELL) {
        return;
    }
    atomicAdd(&cache_sums[at + 1u], 1u);
    for (var channel = 0u; channel < 6u; channel += 1u) {
        let units = record_units(select(light, albedo, channel >= 3u), channel % 3u);
        let low = at + 2u + 2u * channel;
        let before = atomicAdd(&cache_sums[low], units.x);
        let carry = select(0u, 1u, before + units.x < before);
        atomicAdd(&cache_sums[low + 1u], units.y + carry);
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var i = id.x; i < pass_.args.count; i += groups.x * 64u) {
        let key = records[RECORD_WORDS * i];
        if key == NO_CELL {
            continue;
        }
        if pass_.args.adds == 0u {
            claim(cell_slot(key), key);
        } else {
            add(cell_slot(key), key, records[RECORD_WORDS * i + 1u], records[RECORD_WORDS * i + 2u]);
        }
    }
}
