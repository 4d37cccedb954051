// Closest-hit and any-hit traversal of a compressed wide BVH (Ylitie, Karras & Laine, "Efficient Incoherent Ray
// Traversal on GPUs Through Compressed Wide BVHs", HPG 2017), in obvhs's node layout: bounds are interleaved
// (min x of 8 children, max x of 8 children, then y, z).
//
// A group is (base index, mask). Node groups carry hit children in bits 24..31 and the node's imask in bits 0..7;
// triangle groups carry up to 24 hit triangles in bits 0..23.

//!include frame math tables scene

struct Hit {
    t: f32,
    // Number of the triangle, or SPHERE | number of the sphere light, or NO_PRIM. Triangle numbers follow the tree
    // order within an instance and continue from instance to instance.
    prim: u32,
    bary: vec2<f32>,
}

// Stack of pending node groups. It is private to the invocation, so that it is zeroed once and not at every traversal:
// software drivers zero an array element by element and lane by lane. It has an element more than it needs: Mesa keeps
// arrays of up to 256 bytes in registers on AMD's GPUs, where this one would take 64 of them.
var<private> stack: array<vec2<u32>, STACK_SIZE + 1u>;

// Whether a ray of this invocation was cut short: Mesa's software driver ends all loops of an invocation after 65,535
// iterations in total. The sample is dropped and counted.
var<private> was_cut_short: bool;

override HAS_SPHERES: bool = true;

struct Traversal {
    origin: vec3<f32>,
    direction: vec3<f32>,
    inverse: vec3<f32>,
    octant: u32,
    // Perpendicular columns of equal length; the third points along the direction. Distances along it are in units of
    // the direction's length.
    frame: mat3x3<f32>,
}

// Transforms a ray to the instance's space. The direction is not renormalised, so that hit distances equal those in
// world space.
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

fn hit_children4(child_meta: u32, octant: u32, near: vec4<i32>, far: vec4<i32>) -> u32 {
    let inner = ((child_meta & (child_meta << 1u)) & 0x10101010u) >> 4u;
    let slot = (child_meta ^ (octant & (inner * 0xffu))) & 0x1f1f1f1fu;
    let bits = unpack4xU8((child_meta >> 5u) & 0x07070707u);
    let mask = select(vec4<u32>(0u), bits << unpack4xU8(slot), near <= far);
    return mask.x | mask.y | mask.z | mask.w;
}

// Returns the ray's distances to a plane of four children's boxes, as the bits of floats. Float bits sort like integers
// unless both are negative, and then their order does not matter, since both stay below 0. An integer minimum is one
// instruction, but a float minimum is several, since it must handle NaNs.
fn planes(word: u32, scale: f32, offset: f32) -> vec4<i32> {
    return bitcast<vec4<i32>>(vec4<f32>(unpack4xU8(word)) * scale + offset);
}

fn node_part(node: u32, part: u32) -> vec4<u32> {
    return table_row(node * ROWS_PER_NODE + part);
}

// Children of a node that the ray hits up to `t_max`, as a group mask without the imask.
fn hit_children(ray: Traversal, n0: vec4<u32>, child_meta: vec2<u32>, node: u32, t_max: f32) -> u32 {
    let exponents = vec3<u32>(n0.w & 0xffu, (n0.w >> 8u) & 0xffu, (n0.w >> 16u) & 0xffu);
    let unit = bitcast<vec3<f32>>(exponents << vec3<u32>(23u));
    let corner = bitcast<vec3<f32>>(n0.xyz) - ray.origin;
    let scale = unit * ray.inverse;
    // Boxes grow by the rounding errors of their planes and of `intersect_triangle`, at most 16 x 2^-24 of the farthest
    // coordinate, so that no box rejects a ray that its triangle accepts.
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
    let near0 = max(max(planes(nx.x, scale.x, low.x), planes(ny.x, scale.y, low.y)), max(planes(nz.x, scale.z, low.z), vec4<i32>(0)));
    let far0 = min(min(planes(nx.z, scale.x, high.x), planes(ny.z, scale.y, high.y)), planes(nz.z, scale.z, high.z));
    let near1 = max(max(planes(nx.y, scale.x, low.x), planes(ny.y, scale.y, low.y)), max(planes(nz.y, scale.z, low.z), vec4<i32>(0)));
    let far1 = min(min(planes(nx.w, scale.x, high.x), planes(ny.w, scale.y, high.y)), planes(nz.w, scale.z, high.z));
    let furthest = vec4<i32>(bitcast<i32>(t_max));
    return hit_children4(child_meta.x, ray.octant, near0, min(far0, furthest))
        | hit_children4(child_meta.y, ray.octant, near1, min(far1, furthest));
}

// Edge functions of the triangle as the ray sees it, projected along itself (after Woop, Benthin & Wald, "Watertight
// Ray/Triangle Intersection", JCGT 2(1), 2013, with an orthonormal frame instead of their shear). A vertex has the same
// projection in all its triangles, and the sign of an edge function is a comparison of two products, which is right or
// equal however it is rounded or fused. So no ray slips through a shared edge or vertex. Equal counts as inside, so no
// second test in doubles is needed.
//
// The distance is that of the plane, so that a ray that starts on a large triangle does not hit it again. Edge-on, the
// plane has no distance, and the corners' distances are interpolated instead. Returns (t, b1, b2); t < 0: missed.
fn intersect_triangle(ray: Traversal, row: u32, t_max: f32) -> vec3<f32> {
    let tri = stored_triangle(row);
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
    let cross_ = cross(tri.v1 - tri.v0, tri.v2 - tri.v0);
    let normal = cross_ * power_scale(cross_);
    let plane = dot(normal, corner) / dot(normal, ray.direction);
    let rounding = 0x1p-20 * (abs(a.x) + abs(a.y) + abs(a.z));
    let is_between = plane >= min(min(a.z, b.z), c.z) - rounding && plane <= max(max(a.z, b.z), c.z) + rounding;
    let t = select(dot(bary, vec3<f32>(a.z, b.z, c.z)), plane, is_between);
    if !(t > 0.0 && t <= t_max) {
        return vec3<f32>(-1.0);
    }
    return vec3<f32>(t, bary.yz);
}
