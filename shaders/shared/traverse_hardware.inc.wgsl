// Closest-hit and any-hit traversal by hardware ray queries, over the acceleration structures that
// `tables/acceleration.rs` builds. An instance's custom data is its number, and primitives are numbered
// like the triangles of its tree.
//
// The device finds the triangle, and `intersect_triangle` computes the hit, since later code relies on its rounding
// errors. In the device's arithmetic, a ray that starts on a triangle may hit that triangle. The ray is then traced
// once more, with a test of every triangle on its way. The device decides the order of equally distant hits.

//!include frame math tables scene trace

@group(0) @binding(4) var scene_tree: acceleration_structure;

const TERMINATE_ON_FIRST_HIT: u32 = 4u;
const FORCE_NO_OPAQUE: u32 = 2u;
const ALL_INSTANCES: u32 = 0xffu;

struct Found {
    hit: Hit,
    row: u32,
}

// Recomputes a hit that the device has found; NO_PRIM if it is not between the ray's start and `t_max`. If
// `intersect_triangle` misses at an edge, the device's hit counts, since the device is watertight in its own
// arithmetic.
fn meet(world: Traversal, found: RayIntersection, t_max: f32) -> Found {
    var ray = world;
    var prim = found.primitive_index;
    var row = prim;
    if HAS_INSTANCES {
        let instance = frame.geometry.instances + ROWS_PER_INSTANCE * found.instance_custom_data;
        let header = instance_header(instance);
        prim += header.x;
        row = prim + header.y;
        if header.w != 0u {
            ray = local_traversal(instance, world.origin, world.direction);
        }
    }
    let own = intersect_triangle(ray, row, t_max);
    if own.x > 0.0 {
        return Found(Hit(own.x, prim, own.yz), row);
    }
    let tri = stored_triangle(row);
    let cross_ = cross(tri.v1 - tri.v0, tri.v2 - tri.v0);
    let normal = cross_ * power_scale(cross_);
    let plane = dot(normal, tri.v0 - ray.origin) / dot(normal, ray.direction);
    let is_ahead = plane > 0.0 && plane <= t_max;
    return Found(Hit(found.t, select(NO_PRIM, prim, is_ahead), found.barycentrics), row);
}

fn stops(found: Found, key: u32) -> bool {
    if found.hit.prim == NO_PRIM {
        return false;
    }
    if HAS_ALPHA && (stored_triangle(found.row).first_copy & TRIANGLE_ALPHA) != 0u {
        return is_covered(found.row, found.hit.prim, found.hit.bary, key);
    }
    return true;
}

// Whether a ray is valid. Queries of other rays have undefined results.
fn is_ray(origin: vec3<f32>, direction: vec3<f32>, t_max: f32) -> bool {
    const FARTHEST: vec3<f32> = vec3<f32>(3.0e38);
    return all(abs(origin) <= FARTHEST) && all(abs(direction) <= FARTHEST) && dot(direction, direction) > 0.0 && t_max > 0.0;
}

// Returns the nearest hit up to `t_max` that passes its alpha test, or any such hit if `any`. `key` identifies the ray
// for `is_covered`.
//
// The query is declared outside the loop that uses it: Mesa refuses shaders that declare one within a loop.
fn traverse(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, key: u32, any: bool) -> Hit {
    var query: ray_query;
    var found = Found(Hit(t_max, NO_PRIM, vec2<f32>(0.0)), 0u);
    let world = traversal_for(origin, direction, frame_around(direction));
    var flags = select(0u, TERMINATE_ON_FIRST_HIT, any);
    var rounds = select(0u, 2u, is_ray(origin, direction, t_max));
    while rounds > 0u {
        rayQueryInitialize(&query, scene_tree, RayDesc(flags, ALL_INSTANCES, 0.0, t_max, origin, direction));
        var is_done = false;
        while !is_done {
            is_done = !rayQueryProceed(&query);
            if !is_done && stops(meet(world, rayQueryGetCandidateIntersection(&query), t_max), key) {
                rayQueryConfirmIntersection(&query);
            }
        }
        was_cut_short = was_cut_short || !is_done;
        rounds -= 1u;
        let committed = rayQueryGetCommittedIntersection(&query);
        if committed.kind == RAY_QUERY_INTERSECTION_NONE {
            rounds = 0u;
        } else {
            found = meet(world, committed, t_max);
            rounds = select(0u, rounds, found.hit.prim == NO_PRIM);
        }
        flags |= FORCE_NO_OPAQUE;
    }
    if found.hit.prim == NO_PRIM {
        found.hit.t = t_max;
    }
    return found.hit;
}
