// Adds the sums of a frame's records to the means of the radiance cache.

//!include frame grid projection cells bindings

// Samples that the mean of a cell remembers.
const MOST_SAMPLES: f32 = 256.0;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    let a = cache_sums[2u * slot];
    let b = cache_sums[2u * slot + 1u];
    var cell = live_cell(slot);
    cell.key = select(cell.key, a.x, cell.key == NO_CELL);
    cell.age += 1u;
    if a.y > 0u {
        let count = f32(a.y);
        let sum = vec3<f32>(vec3<u32>(a.w, b.y, b.w)) * 0x1p32 + vec3<f32>(vec3<u32>(a.z, b.x, b.z));
        let mean = sum / (count * LIGHT_UNITS * frame.display.storage_scale);
        let samples = min(cell.samples, MOST_SAMPLES);
        cell.light = mix(cell.light, mean, count / (samples + count));
        cell.samples = samples + count;
        cell.age = 0u;
    }
    cache[2u * slot] = vec4<u32>(cell.key, bitcast<u32>(cell.samples), cell.age, 0u);
    cache[2u * slot + 1u] = vec4<u32>(bitcast<vec3<u32>>(cell.light), 0u);
}
