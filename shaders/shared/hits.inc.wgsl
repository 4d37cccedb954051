//!include frame math tables scene light_groups lights trace traverse surface bsdf

// Barycentrics (b1, b2) of a hit, from edge functions on vertices relative to the hit point. With vertices relative to
// the ray's origin, rounding errors would grow with the square of the distance, visibly so on small and distant
// triangles.
fn hit_barycentrics(origin: vec3<f32>, direction: vec3<f32>, hit: Hit) -> vec2<f32> {
    let tri = triangle_at(placed(hit.prim));
    let p = origin + direction * hit.t;
    let a = tri.v0 - p;
    let b = tri.v1 - p;
    let c = tri.v2 - p;
    let v = dot(cross(a, c), direction);
    let w = dot(cross(b, a), direction);
    let det = dot(cross(c, b), direction) + v + w;
    if det == 0.0 {
        return hit.bary;
    }
    // Clamp to the triangle, since outside it, a neighbouring triangle might be in front.
    let bary = max(vec2<f32>(v, w) / det, vec2<f32>(0.0));
    return bary / max(bary.x + bary.y, 1.0);
}

// First entry into a spherical light other than `except` within (0, t_max), or any entry if `any`. Nodes are in
// depth-first order and store the node to skip to after a miss, see `emitters/sphere_tree.rs`.
fn traverse_spheres(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, except: u32, any: bool) -> Hit {
    var hit = Hit(t_max, NO_PRIM, vec2<f32>(0.0));
    let inverse = inverse_of(direction);
    var row = frame.lights.sphere_tree;
    while row < frame.lights.sphere_tree_end {
        let low = table_row(row);
        let high = table_row(row + 1u);
        let a = (bitcast<vec3<f32>>(low.xyz) - origin) * inverse;
        let b = (bitcast<vec3<f32>>(high.xyz) - origin) * inverse;
        let enter = min(a, b);
        let leave_ = max(a, b);
        let near = max(max(enter.x, enter.y), max(enter.z, 0.0));
        let far = min(min(leave_.x, leave_.y), leave_.z) * (1.0 + 4.0 * 1.1920929e-7);
        let meets = near <= min(far, hit.t);
        row = select(low.w, row + 2u, meets);
        if !meets || high.w == NO_LIGHT {
            continue;
        }
        let t = intersect_sphere(origin, direction, high.w);
        if t > 0.0 && t < hit.t && high.w != except {
            hit = Hit(t, SPHERE | high.w, vec2<f32>(0.0));
            if any {
                return hit;
            }
        }
    }
    return hit;
}

fn trace_closest(origin: vec3<f32>, direction: vec3<f32>, key: u32) -> Hit {
    var hit = traverse(origin, direction, 3.0e38, key, false);
    if hit.prim != NO_PRIM {
        hit.bary = hit_barycentrics(origin, direction, hit);
    }
    if HAS_SPHERES {
        let sphere = traverse_spheres(origin, direction, hit.t, NO_LIGHT, false);
        if sphere.prim != NO_PRIM {
            return sphere;
        }
    }
    return hit;
}

// Whether anything but spherical light `except` lies within (0, t_max).
fn is_occluded(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, except: u32, key: u32) -> bool {
    if HAS_SPHERES {
        if traverse_spheres(origin, direction, t_max, except, true).prim != NO_PRIM {
            return true;
        }
    }
    return traverse(origin, direction, t_max, key, true).prim != NO_PRIM;
}

// Whether thin, smooth panes may be in front of lights that only light sampling finds. Such scenes have transparent
// shadows.
override HAS_TRANSPARENT_SHADOWS: bool = true;

// Maximum number of panes that a shadow ray passes. A ray that hits more counts as cut short.
const MOST_PANES: u32 = 64u;

// Fraction of the light sampled for point `p` that reaches `origin`, where the shadow ray starts next to `p`: 0 or 1,
// except through panes in front of delta lights.
fn light_visibility(origin: vec3<f32>, p: vec3<f32>, light: LightSample, key: u32, rays: ptr<function, u32>) -> vec3<f32> {
    var direction = light.direction;
    var t_max = light.distance;
    if t_max < 1e38 {
        // Aim at the exact point, although the ray starts next to `p`.
        let way = (p - origin) + light.direction * light.distance;
        let distance = length(way);
        direction = way / max(distance, 1e-37);
        t_max = distance * light.reach;
    }
    *rays += 1u;
    if !HAS_TRANSPARENT_SHADOWS {
        return select(vec3<f32>(1.0), vec3<f32>(0.0), is_occluded(origin, direction, t_max, light.sphere, key));
    }
    if HAS_SPHERES {
        if traverse_spheres(origin, direction, t_max, light.sphere, true).prim != NO_PRIM {
            return vec3<f32>(0.0);
        }
    }
    // Step from surface to surface. Panes let light pass only if it comes from delta lights. Other lights are
    // also hit by scattered rays that pass through the panes, so their light would be counted twice.
    var visibility = vec3<f32>(1.0);
    var from_ = origin;
    var panes = 0u;
    var is_done = false;
    while !is_done {
        var hit = traverse(from_, direction, t_max, key, false);
        is_done = true;
        if hit.prim != NO_PRIM {
            hit.bary = hit_barycentrics(from_, direction, hit);
            let s = surface_at(hit.prim, hit.bary, from_, direction);
            visibility *= select(vec3<f32>(0.0), straight_transmittance(s, direction), light.is_delta);
            let next = leave(s, direction);
            t_max -= select(0.0, dot(next - from_, direction), light.distance < 1e38);
            from_ = next;
            is_done = max3(visibility) <= 0.0 || t_max <= 0.0;
            panes += 1u;
            if !is_done && panes > MOST_PANES {
                was_cut_short = true;
                is_done = true;
            }
            *rays += select(1u, 0u, is_done);
        }
    }
    return visibility;
}
