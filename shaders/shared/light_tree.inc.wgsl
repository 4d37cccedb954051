// The light tree, which samples one of many lights by its importance to a point (Conty Estevez & Kulla, "Importance
// Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018). See `emitters/light_tree.rs`.

//!include frame tables

// A node of the light tree has two rows: (centre, radius) and (power, axis, cosines, next). This mask selects the index
// in `next`.
const LIGHT_INDEX: u32 = ~(LIGHT_LEAF | LIGHT_TWO_SIDED);
// Minimum probability of a child that may contribute. A smaller one would be lost in the precision of random numbers.
const LEAST_SHARE: f32 = 0x1p-12;
// Rounding error of a cosine.
const COS_SLACK: f32 = 1e-5;

// Importance of a light tree node to a point.
struct Prospect {
    // Importance before division by the squared distance; 0 if the node cannot contribute.
    weight: f32,
    distance2: f32,
    next: u32,
}

// Cosine of max(a - b, 0), for angles from 0 to pi.
fn cos_of_excess(cos_a: f32, sin_a: f32, cos_b: f32, sin_b: f32) -> f32 {
    return select(cos_a * cos_b + sin_a * sin_b, 1.0, cos_a > cos_b);
}

fn sine(cosine: f32) -> f32 {
    return sqrt(max(1.0 - cosine * cosine, 0.0));
}

// Importance as in PBRT 4e, 12.6.3, with spheres as bounds. It is 0 only if no light of the node reaches the side of
// `n`.
fn prospect(p: vec3<f32>, n: vec3<f32>, node: u32) -> Prospect {
    let place = bitcast<vec4<f32>>(table_row(frame.lights.tree + 2u * node));
    let kind = table_row(frame.lights.tree + 2u * node + 1u);
    let power = bitcast<f32>(kind.x);
    let cosines = unpack2x16snorm(kind.z);
    let away = p - place.xyz;
    let radius2 = place.w * place.w;
    let distance2 = max(dot(away, away), 1e-37);
    let result = Prospect(power, max(distance2, max(radius2, 1e-37)), kind.w);
    // Inside the bounds, all directions are possible.
    if distance2 <= radius2 * 1.00001 {
        return result;
    }
    let w = away * inverseSqrt(distance2);
    let sin2_b = radius2 / distance2;
    let sin_b = sqrt(sin2_b);
    let cos_b = sqrt(1.0 - sin2_b);
    let octahedral = unpack2x16snorm(kind.y);
    let z = 1.0 - abs(octahedral.x) - abs(octahedral.y);
    let fold = max(-z, 0.0);
    let axis = normalize(vec3<f32>(octahedral - select(vec2<f32>(-fold), vec2<f32>(fold), octahedral >= vec2<f32>(0.0)), z));
    var cos_w = dot(w, axis);
    if (kind.w & LIGHT_TWO_SIDED) != 0u {
        cos_w = abs(cos_w);
    }
    let off_normals = cos_of_excess(cos_w, sine(cos_w), cosines.x, sine(cosines.x));
    let off = cos_of_excess(off_normals, sine(off_normals), cos_b, sin_b);
    var weight = select(0.0, power * max(off, COS_SLACK), off > cosines.y);
    if any(n != vec3<f32>(0.0)) {
        let cos_n = -dot(w, n);
        let facing = cos_of_excess(cos_n, sine(cos_n), cos_b, sin_b);
        weight *= select(0.0, max(facing, COS_SLACK), facing > -COS_SLACK);
    }
    return Prospect(weight, result.distance2, kind.w);
}

// Probability of the first of two siblings; negative if neither may contribute.
fn first_share(a: Prospect, b: Prospect) -> f32 {
    if a.weight <= 0.0 && b.weight <= 0.0 {
        return -1.0;
    }
    let nearer = min(a.distance2, b.distance2);
    let wa = a.weight * (nearer / a.distance2);
    let wb = b.weight * (nearer / b.distance2);
    let share = select(0.5, wa / (wa + wb), wa + wb > 0.0);
    let least = select(0.0, LEAST_SHARE, a.weight > 0.0);
    let most = select(1.0, 1.0 - LEAST_SHARE, b.weight > 0.0);
    return clamp(share, least, most);
}

struct Pick {
    light: u32,
    probability: f32,
}

fn light_root() -> u32 {
    return table_row(frame.lights.tree + 1u).w;
}

// Descends the light tree. Levels alternate between the two random numbers, so that neither runs out of digits.
fn pick_from_tree(p: vec3<f32>, n: vec3<f32>, choice: vec2<f32>) -> Pick {
    var u = choice;
    var probability = 1.0;
    var next = light_root();
    for (var level = 0u; level < LIGHT_LEVELS && (next & LIGHT_LEAF) == 0u; level += 1u) {
        let a = prospect(p, n, next & LIGHT_INDEX);
        let b = prospect(p, n, (next & LIGHT_INDEX) + 1u);
        let share = first_share(a, b);
        if share < 0.0 {
            return Pick(0u, 0.0);
        }
        let is_first = u.x < share;
        probability *= select(1.0 - share, share, is_first);
        let rest = select((u.x - share) / (1.0 - share), u.x / share, is_first);
        u = vec2<f32>(u.y, min(rest, 0x1.fffffep-1));
        next = select(b.next, a.next, is_first);
    }
    return Pick(next & LIGHT_INDEX, probability);
}

// Probability with which `pick_from_tree` picks a light. Bit k of `trail` is 0 if the path from the root to the light
// goes to the first child at level k, and 1 if it goes to the second.
fn tree_probability(p: vec3<f32>, n: vec3<f32>, trail: u32) -> f32 {
    var probability = 1.0;
    var next = light_root();
    for (var level = 0u; level < LIGHT_LEVELS && (next & LIGHT_LEAF) == 0u; level += 1u) {
        let a = prospect(p, n, next & LIGHT_INDEX);
        let b = prospect(p, n, (next & LIGHT_INDEX) + 1u);
        let share = first_share(a, b);
        if share < 0.0 {
            return 0.0;
        }
        let is_first = ((trail >> level) & 1u) == 0u;
        probability *= select(1.0 - share, share, is_first);
        next = select(b.next, a.next, is_first);
    }
    return probability;
}
