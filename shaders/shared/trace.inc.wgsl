// Closest-hit and any-hit traversal of a compressed wide BVH (Ylitie, Karras & Laine, "Efficient Incoherent Ray
// Traversal on GPUs Through Compressed Wide BVHs", HPG 2017), in obvhs's node layout: bounds are interleaved
// (min x of 8 children, max x of 8 children, then y, z).
//
// A group is (base index, mask). Node groups carry hit children in bits 24..31 and the node's imask in bits 0..7;
// triangle groups carry up to 24 hit triangles in bits 0..23.

struct Hit {
    t: f32,
    // Index of the triangle in tree order, SPHERE | light, or NO_PRIM.
    prim: u32,
    bary: vec2<f32>,
}
const SPHERE: u32 = 0x80000000u;

// Deepest tree that `accel` lets through.
const STACK_SIZE: u32 = 32u;

// Node groups to come back to. Private to the invocation, so that it is zeroed once and not at every traversal: software
// drivers zero an array element by element and lane by lane.
var<private> stack: array<vec2<u32>, STACK_SIZE>;

override HAS_SPHERES: bool = true;

// No triangle lies before it.
const BEFORE_ALL: Hit = Hit(-1.0, 0u, vec2<f32>(0.0));
// Uncovered layers that a ray looks through at most; what lies behind is taken for covered.
const MAX_LAYERS: u32 = 4096u;

struct Traversal {
    origin: vec3<f32>,
    direction: vec3<f32>,
    inverse: vec3<f32>,
    octant: u32,
}

fn traversal_for(origin: vec3<f32>, direction: vec3<f32>) -> Traversal {
    let tiny = abs(direction) < vec3<f32>(1e-18);
    let safe = select(direction, select(vec3<f32>(1e-18), vec3<f32>(-1e-18), direction < vec3<f32>(0.0)), tiny);
    let flip = select(vec3<u32>(4u, 2u, 1u), vec3<u32>(0u), direction < vec3<f32>(0.0));
    return Traversal(origin, direction, 1.0 / safe, (flip.x | flip.y | flip.z) * 0x01010101u);
}

fn hit_children4(child_meta: u32, octant: u32, near: vec4<f32>, far: vec4<f32>) -> u32 {
    let inner = ((child_meta & (child_meta << 1u)) & 0x10101010u) >> 4u;
    let slot = (child_meta ^ (octant & (inner * 0xffu))) & 0x1f1f1f1fu;
    let bits = unpack4xU8((child_meta >> 5u) & 0x07070707u);
    let mask = select(vec4<u32>(0u), bits << unpack4xU8(slot), near <= far);
    return mask.x | mask.y | mask.z | mask.w;
}

fn planes(word: u32, scale: f32, offset: f32) -> vec4<f32> {
    return vec4<f32>(unpack4xU8(word)) * scale + offset;
}

fn node_part(node: u32, part: u32) -> vec4<u32> {
    return textureLoad(nodes, vec2<u32>((node & 1023u) * 5u + part, node >> 10u), 0);
}

// Which children of a node the ray meets before `t_max`, as a group mask without the imask.
fn hit_children(ray: Traversal, n0: vec4<u32>, child_meta: vec2<u32>, node: u32, t_max: f32) -> u32 {
    let exponents = vec3<u32>(n0.w & 0xffu, (n0.w >> 8u) & 0xffu, (n0.w >> 16u) & 0xffu);
    let scale = bitcast<vec3<f32>>(exponents << vec3<u32>(23u)) * ray.inverse;
    let offset = (bitcast<vec3<f32>>(n0.xyz) - ray.origin) * ray.inverse;
    let x = node_part(node, 2u);
    let y = node_part(node, 3u);
    let z = node_part(node, 4u);
    let nx = select(x, x.zwxy, ray.direction.x < 0.0);
    let ny = select(y, y.zwxy, ray.direction.y < 0.0);
    let nz = select(z, z.zwxy, ray.direction.z < 0.0);
    // The far side is moved out by a few ulp, so that flat boxes are never missed by rounding.
    const SLACK: f32 = 1.0 + 4.0 * 1.1920929e-7;
    let near0 = max(max(planes(nx.x, scale.x, offset.x), planes(ny.x, scale.y, offset.y)), max(planes(nz.x, scale.z, offset.z), vec4<f32>(0.0)));
    let far0 = min(min(planes(nx.z, scale.x, offset.x), planes(ny.z, scale.y, offset.y)), planes(nz.z, scale.z, offset.z)) * SLACK;
    let near1 = max(max(planes(nx.y, scale.x, offset.x), planes(ny.y, scale.y, offset.y)), max(planes(nz.y, scale.z, offset.z), vec4<f32>(0.0)));
    let far1 = min(min(planes(nx.w, scale.x, offset.x), planes(ny.w, scale.y, offset.y)), planes(nz.w, scale.z, offset.z)) * SLACK;
    return hit_children4(child_meta.x, ray.octant, near0, min(far0, vec4<f32>(t_max)))
        | hit_children4(child_meta.y, ray.octant, near1, min(far1, vec4<f32>(t_max)));
}

// Edge functions on vertices relative to the ray's origin: the value of a shared edge is the same number with the
// other sign in the neighbouring triangle, so no ray slips between the two. Returns (t, b1, b2); t < 0: missed.
fn intersect_triangle(origin: vec3<f32>, direction: vec3<f32>, prim: u32, t_max: f32) -> vec3<f32> {
    let tri = triangles[prim];
    let a = tri.v0 - origin;
    let b = tri.v1 - origin;
    let c = tri.v2 - origin;
    let u = dot(cross(c, b), direction);
    let v = dot(cross(a, c), direction);
    let w = dot(cross(b, a), direction);
    let det = u + v + w;
    let inside = (min(min(u, v), w) >= 0.0) || (max(max(u, v), w) <= 0.0);
    if !inside || det == 0.0 {
        return vec3<f32>(-1.0);
    }
    let normal = cross(b - a, c - a);
    let facing = dot(normal, direction);
    let t = dot(normal, a) / facing;
    if !(t > 0.0 && t <= t_max) {
        return vec3<f32>(-1.0);
    }
    let inv = 1.0 / det;
    return vec3<f32>(t, v * inv, w * inv);
}

// Whether a triangle stops every ray, without a look at its alpha.
fn is_opaque(prim: u32) -> bool {
    return !HAS_ALPHA || (triangles[prim].flags & TRIANGLE_ALPHA) == 0u;
}

// The first triangle up to `t_max` in the order of (distance, index) that comes after `after`, or any opaque one if
// `any`: always a literal, so that each call is compiled for its kind.
//
// Alpha is looked at by the callers, between traversals. In here it would be looked at by every lane at every triangle,
// since software drivers mask branches instead of taking them.
fn traverse(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, after: Hit, any: bool) -> Hit {
    var hit = Hit(t_max, NO_PRIM, vec2<f32>(0.0));
    let ray = traversal_for(origin, direction);
    var top = 0u;
    var group = vec2<u32>(0u, 0x80000000u);
    loop {
        var leaf = group;
        if group.y > 0x00ffffffu {
            let bit = firstLeadingBit(group.y);
            let slot = (bit - 24u) ^ (ray.octant & 7u);
            let child = group.x + countOneBits(group.y & ~(0xffffffffu << slot) & 0xffu);
            group.y &= ~(1u << bit);
            if group.y > 0x00ffffffu && top < STACK_SIZE {
                stack[top] = group;
                top += 1u;
            }
            let n0 = node_part(child, 0u);
            let n1 = node_part(child, 1u);
            let mask = hit_children(ray, n0, n1.zw, child, hit.t);
            group = vec2<u32>(n1.x, (mask & 0xff000000u) | (n0.w >> 24u));
            leaf = vec2<u32>(n1.y, mask & 0x00ffffffu);
        } else {
            group = vec2<u32>(0u);
        }
        while leaf.y != 0u {
            let prim = leaf.x + firstTrailingBit(leaf.y);
            leaf.y &= leaf.y - 1u;
            let found = intersect_triangle(origin, direction, prim, hit.t);
            let is_first = found.x > 0.0 && (found.x < hit.t || prim < hit.prim);
            let is_after = !HAS_ALPHA || found.x > after.t || (found.x == after.t && prim > after.prim);
            if is_first && is_after {
                hit = Hit(found.x, prim, found.yz);
                if any && is_opaque(prim) {
                    return hit;
                }
            }
        }
        if group.y <= 0x00ffffffu {
            if top == 0u {
                return hit;
            }
            top -= 1u;
            group = stack[top];
        }
    }
    return hit;
}

// Barycentrics (b1, b2) of a hit, from edge functions on vertices relative to the hit itself: relative to the ray's
// origin, their rounding errors grow with the square of the distance, which small and distant triangles show.
fn hit_barycentrics(origin: vec3<f32>, direction: vec3<f32>, hit: Hit) -> vec2<f32> {
    let tri = triangles[hit.prim];
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
    // Not outside the triangle, where the next one might stand in front.
    let bary = max(vec2<f32>(v, w) / det, vec2<f32>(0.0));
    return bary / max(bary.x + bary.y, 1.0);
}

fn trace_closest(origin: vec3<f32>, direction: vec3<f32>, key: u32) -> Hit {
    var hit = BEFORE_ALL;
    for (var layer = 0u; layer < MAX_LAYERS; layer += 1u) {
        hit = traverse(origin, direction, 3.0e38, hit, false);
        if !HAS_ALPHA || hit.prim == NO_PRIM || is_opaque(hit.prim) || is_covered(hit.prim, hit.bary, key) {
            break;
        }
    }
    if hit.prim != NO_PRIM {
        hit.bary = hit_barycentrics(origin, direction, hit);
    }
    if HAS_SPHERES {
        for (var i = 0u; i < frame.sphere_count; i += 1u) {
            let t = intersect_sphere(origin, direction, i);
            if t > 0.0 && t < hit.t {
                hit = Hit(t, SPHERE | i, vec2<f32>(0.0));
            }
        }
    }
    return hit;
}

// Whether anything lies within (0, t_max), spherical light `except` left out.
fn is_occluded(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, except: u32, key: u32) -> bool {
    if HAS_SPHERES {
        for (var i = 0u; i < frame.sphere_count; i += 1u) {
            let t = intersect_sphere(origin, direction, i);
            if i != except && t > 0.0 && t < t_max {
                return true;
            }
        }
    }
    var hit = BEFORE_ALL;
    for (var layer = 0u; layer < MAX_LAYERS; layer += 1u) {
        hit = traverse(origin, direction, t_max, hit, true);
        if !HAS_ALPHA || hit.prim == NO_PRIM || is_opaque(hit.prim) || is_covered(hit.prim, hit.bary, key) {
            break;
        }
    }
    return hit.prim != NO_PRIM;
}
