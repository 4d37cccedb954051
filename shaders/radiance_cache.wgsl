// Adds the records of a frame to the radiance cache, in three launches. Each cell has one slot in the table, given by its
// key. Of several new cells with the same slot, the one with the largest key gets it, so that the order of the records
// does not matter; for the same reason, light is summed in integers.

//!include frame grid projection cells bindings

// Words of a slot in `cache_sums`: the key of the new cell, the number of records, and for each channel the low and the
// high word of the sum of their light.
const SUM_WORDS: u32 = 8u;

// Samples that the mean of a cell remembers.
const MOST_SAMPLES: f32 = 256.0;
// Frames after which a cell without new samples loses its slot.
const MOST_AGE: u32 = 64u;

const INVOCATIONS: u32 = CACHE_SLOTS;

// The cell that has held the slot since an earlier frame.
fn tenant(slot: u32) -> Cell {
    let cell = unpack_cell(last_cache[2u * slot], last_cache[2u * slot + 1u]);
    if frame.history.rows == NO_HISTORY || cell.age >= MOST_AGE {
        return Cell();
    }
    return cell;
}

fn claim(record: vec2<u32>) {
    let slot = cell_slot(record.x);
    if tenant(slot).key == NO_CELL {
        atomicMax(&cache_sums[SUM_WORDS * slot], record.x);
    }
}

fn add(record: vec2<u32>) {
    let slot = cell_slot(record.x);
    let at = SUM_WORDS * slot;
    let kept = tenant(slot).key;
    let owner = select(kept, atomicLoad(&cache_sums[at]), kept == NO_CELL);
    if owner != record.x {
        return;
    }
    atomicAdd(&cache_sums[at + 1u], 1u);
    for (var channel = 0u; channel < 3u; channel += 1u) {
        let units = light_units(record.y, channel);
        let low = at + 2u + 2u * channel;
        let before = atomicAdd(&cache_sums[low], units.x);
        let carry = select(0u, 1u, before + units.x < before);
        atomicAdd(&cache_sums[low + 1u], units.y + carry);
    }
}

fn renew(slot: u32) {
    let at = SUM_WORDS * slot;
    var cell = tenant(slot);
    cell.key = select(cell.key, atomicLoad(&cache_sums[at]), cell.key == NO_CELL);
    let count = f32(atomicLoad(&cache_sums[at + 1u]));
    cell.age += 1u;
    if count > 0.0 {
        var sum: vec3<f32>;
        for (var channel = 0u; channel < 3u; channel += 1u) {
            let low = f32(atomicLoad(&cache_sums[at + 2u + 2u * channel]));
            let high = f32(atomicLoad(&cache_sums[at + 3u + 2u * channel]));
            sum[channel] = high * 0x1p32 + low;
        }
        let mean = sum / (count * LIGHT_UNITS * frame.display.storage_scale);
        let samples = min(cell.samples, MOST_SAMPLES);
        cell.light = mix(cell.light, mean, count / (samples + count));
        cell.samples = samples + count;
        cell.age = 0u;
    }
    cache[2u * slot] = vec4<u32>(cell.key, bitcast<u32>(cell.samples), cell.age, 0u);
    cache[2u * slot + 1u] = vec4<u32>(bitcast<vec3<u32>>(cell.light), 0u);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if pass_.args[0] == RENEW {
        renew(id.x);
        return;
    }
    for (var i = id.x; i < pass_.args[1]; i += INVOCATIONS) {
        let record = records[i];
        if record.x == NO_CELL {
            continue;
        }
        if pass_.args[0] == CLAIM {
            claim(record);
        } else {
            add(record);
        }
    }
}
