// Closest-hit and any-hit traversal of a compressed wide BVH (Ylitie, Karras & Laine, "Efficient Incoherent Ray
// Traversal on GPUs Through Compressed Wide BVHs", HPG 2017), in obvhs's node layout: bounds are interleaved
// (min x of 8 children, max x of 8 children, then y, z).
//
// A group is (base index, mask). Node groups carry hit children in bits 24..31 and the node's imask in bits 0..7;
// triangle groups carry up to 24 hit triangles in bits 0..23.

struct Hit {
    t: f32,
    // Number of the triangle, in tree order within its instance, SPHERE | light, or NO_PRIM.
    prim: u32,
    bary: vec2<f32>,
}

// Node groups to come back to. Private to the invocation, so that it is zeroed once and not at every traversal: software
// drivers zero an array element by element and lane by lane.
var<private> stack: array<vec2<u32>, STACK_SIZE>;

// Whether a ray of this invocation was left before its end: Mesa's software driver ends every loop of an invocation once
// they have made 65,535 rounds together. The sample is dropped and counted.
var<private> was_cut_short: bool;

override HAS_SPHERES: bool = true;

struct Traversal {
    origin: vec3<f32>,
    direction: vec3<f32>,
    inverse: vec3<f32>,
    octant: u32,
    // Perpendicular columns of one length; the third has the direction. Distances along it count in the direction's lengths.
    frame: mat3x3<f32>,
}

// Not renormalised, so that distances are those in the world.
fn local_traversal(instance: u32, origin: vec3<f32>, direction: vec3<f32>) -> Traversal {
    let m = affine_at(instance + LOCAL_FROM_WORLD);
    let along = transform_vector(m, direction);
    let scale = 1.0 / length(along);
    return traversal_for(transform_point(m, origin), along, frame_around(along * scale) * scale);
}

fn traversal_for(origin: vec3<f32>, direction: vec3<f32>, frame: mat3x3<f32>) -> Traversal {
    let flip = select(vec3<u32>(4u, 2u, 1u), vec3<u32>(0u), direction < vec3<f32>(0.0));
    return Traversal(origin, direction, inverse_of(direction), (flip.x | flip.y | flip.z) * 0x01010101u, frame);
}

fn inverse_of(direction: vec3<f32>) -> vec3<f32> {
    let tiny = abs(direction) < vec3<f32>(1e-18);
    return 1.0 / select(direction, select(vec3<f32>(1e-18), vec3<f32>(-1e-18), direction < vec3<f32>(0.0)), tiny);
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

// Which children of a node the ray meets up to `t_max`, as a group mask without the imask.
fn hit_children(ray: Traversal, n0: vec4<u32>, child_meta: vec2<u32>, node: u32, t_max: f32) -> u32 {
    let exponents = vec3<u32>(n0.w & 0xffu, (n0.w >> 8u) & 0xffu, (n0.w >> 16u) & 0xffu);
    let unit = bitcast<vec3<f32>>(exponents << vec3<u32>(23u));
    let corner = bitcast<vec3<f32>>(n0.xyz) - ray.origin;
    let scale = unit * ray.inverse;
    // Boxes grow by the rounding errors of their planes and of `intersect_triangle`, at most 16 x 2^-24 of the farthest
    // coordinate: what the triangle's test lets in must not be kept out by its box.
    let reach = abs(corner) + 256.0 * unit;
    let slack = max(max(reach.x, reach.y), reach.z) * 0x1p-20 * abs(ray.inverse);
    let low = corner * ray.inverse - slack;
    let high = corner * ray.inverse + slack;
    let x = node_part(node, 2u);
    let y = node_part(node, 3u);
    let z = node_part(node, 4u);
    let nx = select(x, x.zwxy, ray.direction.x < 0.0);
    let ny = select(y, y.zwxy, ray.direction.y < 0.0);
    let nz = select(z, z.zwxy, ray.direction.z < 0.0);
    let near0 = max(max(planes(nx.x, scale.x, low.x), planes(ny.x, scale.y, low.y)), max(planes(nz.x, scale.z, low.z), vec4<f32>(0.0)));
    let far0 = min(min(planes(nx.z, scale.x, high.x), planes(ny.z, scale.y, high.y)), planes(nz.z, scale.z, high.z));
    let near1 = max(max(planes(nx.y, scale.x, low.x), planes(ny.y, scale.y, low.y)), max(planes(nz.y, scale.z, low.z), vec4<f32>(0.0)));
    let far1 = min(min(planes(nx.w, scale.x, high.x), planes(ny.w, scale.y, high.y)), planes(nz.w, scale.z, high.z));
    return hit_children4(child_meta.x, ray.octant, near0, min(far0, vec4<f32>(t_max)))
        | hit_children4(child_meta.y, ray.octant, near1, min(far1, vec4<f32>(t_max)));
}

// Edge functions of the triangle as the ray sees it, projected along itself (after Woop, Benthin & Wald, "Watertight
// Ray/Triangle Intersection", JCGT 2(1), 2013, with an orthonormal frame for their shear). A vertex has one projection
// in all its triangles, and the sign of an edge function is a comparison of two products, which is right or equal
// whatever is rounded or fused: no ray slips through a shared edge or vertex. Equal is inside, so no second test in
// doubles is needed.
//
// The distance is that of the plane, which keeps a ray that starts on a large triangle from meeting it again; seen from
// the edge the plane has none, and the corners' distances are mixed instead. Returns (t, b1, b2); t < 0: missed.
fn intersect_triangle(ray: Traversal, row: u32, t_max: f32) -> vec3<f32> {
    let tri = triangles[row];
    let corner = tri.v0 - ray.origin;
    let a = corner * ray.frame;
    let b = (tri.v1 - ray.origin) * ray.frame;
    let c = (tri.v2 - ray.origin) * ray.frame;
    let left = vec3<f32>(c.x * b.y, a.x * c.y, b.x * a.y);
    let right = vec3<f32>(c.y * b.x, a.y * c.x, b.y * a.x);
    let weights = left - right;
    let sum = weights.x + weights.y + weights.z;
    if !(all(left >= right) || all(left <= right)) || sum == 0.0 {
        return vec3<f32>(-1.0);
    }
    let bary = weights / sum;
    let normal = cross(tri.v1 - tri.v0, tri.v2 - tri.v0);
    let plane = dot(normal, corner) / dot(normal, ray.direction);
    let rounding = 0x1p-20 * (abs(a.x) + abs(a.y) + abs(a.z));
    let is_between = plane >= min(min(a.z, b.z), c.z) - rounding && plane <= max(max(a.z, b.z), c.z) + rounding;
    let t = select(dot(bary, vec3<f32>(a.z, b.z, c.z)), plane, is_between);
    if !(t > 0.0 && t <= t_max) {
        return vec3<f32>(-1.0);
    }
    return vec3<f32>(t, bary.yz);
}

// The first covered triangle up to `t_max` in the order of (distance, index), or any if `any`: always a literal, so that
// each call is compiled for its kind. `key` names the ray to `is_covered`.
//
// Where a triangle's alpha must be looked at, the walk pauses. Rays of a subgroup then look together: software drivers
// mask branches instead of taking them, so that a look on the way would be paid for at every triangle.
fn traverse(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, key: u32, any: bool) -> Hit {
    var hit = Hit(t_max, NO_PRIM, vec2<f32>(0.0));
    // What the walk pauses for: a nearer hit, if it is covered.
    var candidate = hit;
    var candidate_row = 0u;
    let world = traversal_for(origin, direction, frame_around(direction));
    var ray = world;
    var top = 0u;
    var group = vec2<u32>(0u, 0x80000000u);
    var leaf = vec2<u32>(0u);
    var is_done = false;
    // Of the instance that the ray is in. It begins in the first, which is nowhere moved.
    var is_inside = true;
    var row_offset = 0u;
    // Groups below belong to the tree over instances.
    var base = 0u;
    // A triangle group whose triangles are instances, still to be entered.
    var entries = vec2<u32>(0u);
    if HAS_INSTANCES && frame.geometry.instance_count > 1u {
        stack[0] = vec2<u32>(frame.geometry.instance_tree, 0x80000000u);
        top = 1u;
        base = 1u;
    }
    loop {
        while !is_done && (!HAS_ALPHA || candidate.prim == NO_PRIM) {
            if HAS_ALPHA && leaf.y != 0u {
                // The rest of the triangles among which the walk paused.
            } else if group.y > 0x00ffffffu {
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
                leaf = group;
                group = vec2<u32>(0u);
            }
            if HAS_INSTANCES && !is_inside {
                entries = leaf;
                leaf.y = 0u;
                if entries.y != 0u && group.y > 0x00ffffffu && top < STACK_SIZE {
                    stack[top] = group;
                    top += 1u;
                    group.y = 0u;
                }
            }
            while leaf.y != 0u {
                let row = leaf.x + firstTrailingBit(leaf.y);
                leaf.y &= leaf.y - 1u;
                let found = intersect_triangle(ray, row, hit.t);
                let prim = row - row_offset;
                let is_first = found.x > 0.0 && (found.x < hit.t || prim < hit.prim);
                if is_first {
                    let nearer = Hit(found.x, prim, found.yz);
                    if HAS_ALPHA && (triangles[row].flags & TRIANGLE_ALPHA) != 0u {
                        candidate = nearer;
                        candidate_row = row;
                        break;
                    }
                    hit = nearer;
                    if any {
                        is_done = true;
                        break;
                    }
                }
            }
            if HAS_INSTANCES {
                // Whether the ray leaves an instance, or the tree over them for one.
                let is_through = select(entries.y != 0u, top == base, is_inside);
                var is_over = group.y <= 0x00ffffffu && leaf.y == 0u && is_through && !is_done;
                // Once, as a loop: software drivers skip no branch.
                while is_over {
                    is_over = false;
                    is_inside = entries.y != 0u;
                    if is_inside {
                        let number = entries.x + firstTrailingBit(entries.y);
                        let instance = frame.geometry.instances + ROWS_PER_INSTANCE * number;
                        entries.y &= entries.y - 1u;
                        let header = instance_header(instance);
                        row_offset = header.y;
                        group = vec2<u32>(header.z, 0x80000000u);
                        base = top;
                        ray = local_traversal(instance, origin, direction);
                    } else {
                        base = 0u;
                        ray = world;
                    }
                }
            }
            if group.y <= 0x00ffffffu && leaf.y == 0u {
                is_done = is_done || top == 0u;
                top = max(top, 1u) - 1u;
                group = stack[top];
            }
        }
        if !HAS_ALPHA || candidate.prim == NO_PRIM {
            break;
        }
        if is_covered(candidate_row, candidate.prim, candidate.bary, key) {
            hit = candidate;
            is_done = is_done || any;
        }
        candidate.prim = NO_PRIM;
    }
    was_cut_short = was_cut_short || !is_done;
    return hit;
}

// Barycentrics (b1, b2) of a hit, from edge functions on vertices relative to the hit itself: relative to the ray's
// origin, their rounding errors grow with the square of the distance, which small and distant triangles show.
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
    // Not outside the triangle, where the next one might stand in front.
    let bary = max(vec2<f32>(v, w) / det, vec2<f32>(0.0));
    return bary / max(bary.x + bary.y, 1.0);
}

// The first entry into a spherical light other than `except` within (0, t_max), or any if `any`. Nodes are in
// depth-first order and say where to go on a miss, see `emitters/sphere_tree.rs`.
fn traverse_spheres(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, except: u32, any: bool) -> Hit {
    var hit = Hit(t_max, NO_PRIM, vec2<f32>(0.0));
    let inverse = inverse_of(direction);
    var row = frame.lights.sphere_tree;
    while row < frame.lights.sphere_tree_end {
        let low = tree_row(row);
        let high = tree_row(row + 1u);
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

// Whether anything lies within (0, t_max), spherical light `except` left out.
fn is_occluded(origin: vec3<f32>, direction: vec3<f32>, t_max: f32, except: u32, key: u32) -> bool {
    if HAS_SPHERES {
        if traverse_spheres(origin, direction, t_max, except, true).prim != NO_PRIM {
            return true;
        }
    }
    return traverse(origin, direction, t_max, key, true).prim != NO_PRIM;
}

// Whether anything stands between a ray's start near `p` and what `sample_light` has sampled at `p`.
fn is_light_hidden(origin: vec3<f32>, p: vec3<f32>, light: LightSample, key: u32) -> bool {
    var direction = light.direction;
    var t_max = light.distance;
    if t_max < 1e38 {
        // To the very point, though the ray starts beside `p`.
        let way = (p - origin) + light.direction * light.distance;
        let distance = length(way);
        direction = way / max(distance, 1e-37);
        t_max = distance * light.reach;
    }
    return is_occluded(origin, direction, t_max, light.sphere, key);
}
