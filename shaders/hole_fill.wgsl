// Path tracing of the pixels that reprojection left open, from their compacted list, so that no lane idles: the
// divergence that Leria et al. name as the limit of their hole-filling.

//!include frame rng scene lights trace surface bsdf path pack pixel

// Count of holes, then the dispatch's three workgroup counts, then pixel indices.
@group(1) @binding(6) var<storage, read> holes: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var i = id.x; i < holes[0]; i += groups.x * 64u) {
        let at = holes[4u + i];
        sample_pixel(vec2<u32>(at % frame.width, at / frame.width), pass_.view);
    }
}
