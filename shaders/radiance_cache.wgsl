// Adds the sums of a frame's records to the means of the radiance cache.

//!include frame cells bindings

// Samples that the mean of a cell remembers.
const MOST_SAMPLES: f32 = 256.0;

// Sum of albedo up to which a cell counts as black.
const LEAST: vec3<f32> = vec3<f32>(1e-6);

// Sum of three channels, whose low and high words alternate.
fn sum_of(a: vec2<u32>, b: vec4<u32>) -> vec3<f32> {
    let sum = vec3<f32>(vec3<u32>(a.y, b.y, b.w)) * 0x1p32 + vec3<f32>(vec3<u32>(a.x, b.x, b.z));
    return sum * (1.0 / RECORD_UNITS);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let slot = id.x;
    let a = cache_sums[4u * slot];
    var cell = live_cell(slot);
    if a.x != NO_CELL {
        cell = Cell();
        cell.key = a.x;
        cell.reflections = frame.sampling.reflections;
    }
    cell.age += 1u;
    if a.y > 0u {
        let c = cache_sums[4u * slot + 2u];
        let light = sum_of(a.zw, cache_sums[4u * slot + 1u]);
        let albedo = sum_of(c.xy, vec4<u32>(c.zw, cache_sums[4u * slot + 3u].xy));
        let kept = min(cell.samples, MOST_SAMPLES);
        let old = cell.albedo * (kept / max(cell.samples, 1.0));
        let sum = old + albedo;
        // The mean of light over the mean of albedo is that of all surfaces, black ones too.
        cell.light = select(vec3<f32>(0.0), (cell.light * old + light) / max(sum, LEAST), sum > LEAST);
        cell.albedo = sum;
        cell.samples = kept + f32(a.y);
        cell.age = 0u;
    }
    cache[3u * slot] = vec4<u32>(cell.key, bitcast<u32>(cell.samples), cell.age, cell.reflections);
    cache[3u * slot + 1u] = vec4<u32>(bitcast<vec3<u32>>(cell.light), 0u);
    cache[3u * slot + 2u] = vec4<u32>(bitcast<vec3<u32>>(cell.albedo), 0u);
}
