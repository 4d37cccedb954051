// Sums the records of a frame for each slot of the radiance cache, in two launches. Of several new cells with the same
// slot, the one with the largest key gets it, so that the order of the records does not matter; for the same reason,
// light is summed in integers.

//!include frame grid projection cells bindings

// A channel of packed light as a 64-bit integer in LIGHT_UNITS: low and high word.
fn light_units(packed: u32, channel: u32) -> vec2<u32> {
    let m = (packed >> (9u * channel)) & 511u;
    let exponent = packed >> 27u;
    return vec2<u32>(m << exponent, (m >> 1u) >> (31u - exponent));
}

fn claim(slot: u32, key: u32) {
    if live_cell(slot).key == NO_CELL {
        atomicMax(&cache_sums[SUM_WORDS * slot], key);
    }
}

fn add(slot: u32, key: u32, light: u32) {
    let at = SUM_WORDS * slot;
    let kept = live_cell(slot).key;
    let owner = select(kept, atomicLoad(&cache_sums[at]), kept == NO_CELL);
    if owner != key {
        return;
    }
    atomicAdd(&cache_sums[at + 1u], 1u);
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let units = light_units(light, channel);
        let low = at + 2u + 2u * channel;
        let before = atomicAdd(&cache_sums[low], units.x);
        let carry = select(0u, 1u, before + units.x < before);
        atomicAdd(&cache_sums[low + 1u], units.y + carry);
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var i = id.x; i < pass_.args[1]; i += groups.x * 64u) {
        let record = records[i];
        if record.x == NO_CELL {
            continue;
        }
        if pass_.args[0] == CLAIM {
            claim(cell_slot(record.x), record.x);
        } else {
            add(cell_slot(record.x), record.x, record.y);
        }
    }
}
