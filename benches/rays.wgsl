// Traces given rays, one invocation per pixel: its path's segments one after another, as path tracing meets them.

//!include frame hits

struct BenchRay {
    origin: vec3<f32>,
    // 0: the path has ended.
    t_max: f32,
    direction: vec3<f32>,
    pad: f32,
}

@group(1) @binding(0) var<storage, read> bench_rays: array<BenchRay>;
// Distance and triangle per ray.
@group(1) @binding(1) var<storage, read_write> bench_hits: array<vec2<u32>>;

override SEGMENTS: u32 = 1u;
override ANY_HIT: bool = false;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.camera.width || id.y >= frame.camera.height {
        return;
    }
    for (var segment = 0u; segment < SEGMENTS; segment += 1u) {
        let at = (segment * frame.camera.height + id.y) * frame.camera.width + id.x;
        let ray = bench_rays[at];
        if ray.t_max == 0.0 {
            break;
        }
        if ANY_HIT {
            let occluded = is_occluded(ray.origin, ray.direction, ray.t_max, NO_LIGHT, 0u);
            bench_hits[at] = vec2<u32>(u32(occluded), NO_PRIM);
        } else {
            let hit = trace_closest(ray.origin, ray.direction, 0u);
            bench_hits[at] = vec2<u32>(bitcast<u32>(hit.t), hit.prim);
        }
    }
}
