// Lights and how one is chosen and sampled. There are three groups: lights that are somewhere (emissive triangles,
// points, spots and spheres), directional lights, and an environment image. Groups that are not empty are equally
// likely. In the first, a tree of lights leads to one by what it may bring to the point (Conty Estevez & Kulla 2018,
// see `emitters/light_tree.rs`); directional lights are picked in proportion to their irradiance, by an alias table
// (Walker 1977). A constant environment is no light to pick: cosine-weighted bounces find it with less noise.

override HAS_EMISSIVE: bool = true;
override HAS_LOCAL_LIGHTS: bool = true;
override HAS_DIRECTIONAL: bool = true;
override HAS_ENV_MAP: bool = true;

struct Light {
    // Triangle: unused. Local: position. Directional: the way to the light.
    position: vec3<f32>,
    kind: u32,
    // Triangle: unused (materials hold it). Local: W/sr, or radiance of a sphere. Directional: W/m2.
    strength: vec3<f32>,
    // Triangle: area. Local: of the sphere. Directional: 1 - cos of the disc's half-angle.
    radius: f32,
    // Triangle: normal. Spot: axis.
    axis: vec3<f32>,
    cos_outer: f32,
    // Spot: 1 / (cos_inner - cos_outer).
    cone_scale: f32,
    // Directional: probability in its group; alias table: keep this entry with probability `keep`, else take `alias_`.
    pick: f32,
    keep: f32,
    alias_: u32,
    prim: u32,
    // The way through the light tree: bit k is set where it takes the second child at level k.
    trail: u32,
    pad0: u32,
    pad1: u32,
}
const LIGHT_SPOT: u32 = 1u;
const LIGHT_TRIANGLE: u32 = 2u;

// Alias table and density of the environment's grid, see `emitters/env_grid.rs`. Densities are over the map's (u, v)
// square.
struct EnvCell {
    keep: f32,
    alias_: u32,
    density: f32,
}

// Spheres first, then other local lights, then directional ones.
@group(0) @binding(9) var<storage, read> lights: array<Light>;
@group(0) @binding(10) var env_map: texture_2d<f32>;
@group(0) @binding(11) var<storage, read> env_cells: array<EnvCell>;

const NO_LIGHT: u32 = 0xffffffffu;
const PI: f32 = 3.14159265358979;

struct LightSample {
    direction: vec3<f32>,
    // 3e38: infinitely far.
    distance: f32,
    radiance: vec3<f32>,
    // Solid-angle density; 0: nothing sampled. Delta lights: the probability of the pick, and `is_delta`.
    pdf: f32,
    is_delta: bool,
    // Spherical light that the shadow ray must not be stopped by.
    sphere: u32,
    // How much of the way is to be free: all but the error of where a ray meets the light.
    reach: f32,
}

fn no_light() -> LightSample {
    return LightSample(vec3<f32>(0.0, 1.0, 0.0), 0.0, vec3<f32>(0.0), 0.0, false, NO_LIGHT, 1.0);
}

// Nodes of the light tree: (centre, radius), (power, axis, cosines, next). See `emitters/light_tree.rs`.
const LIGHT_LEAF: u32 = 0x80000000u;
const LIGHT_TWO_SIDED: u32 = 0x40000000u;
const LIGHT_INDEX: u32 = 0x3fffffffu;
const LIGHT_LEVELS: u32 = 32u;
// Least probability of a child that may bring light: no less than random numbers resolve.
const LEAST_SHARE: f32 = 0x1p-12;
// What rounding may take from a cosine.
const COS_SLACK: f32 = 1e-5;

// What a node of the light tree may bring to a point.
struct Prospect {
    // Over the squared distance; 0: nothing.
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

// PBRT 4e, 12.6.3, for bounds that are spheres. 0 only where no light of the node reaches the side of `n`.
fn prospect(p: vec3<f32>, n: vec3<f32>, node: u32) -> Prospect {
    let place = bitcast<vec4<f32>>(tree_row(frame.light_tree + 2u * node));
    let kind = tree_row(frame.light_tree + 2u * node + 1u);
    let power = bitcast<f32>(kind.x);
    let cosines = unpack2x16snorm(kind.z);
    let away = p - place.xyz;
    let radius2 = place.w * place.w;
    let distance2 = max(dot(away, away), 1e-37);
    let result = Prospect(power, max(distance2, max(radius2, 1e-37)), kind.w);
    // Inside the bounds, all directions are open.
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

// Of two siblings, the probability of the first; negative if neither may bring light.
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
    return tree_row(frame.light_tree + 1u).w;
}

// Goes down the light tree. Levels take turns in using up the two numbers, so that neither runs out of digits.
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

// Probability with which `pick_from_tree` comes to the light of that trail.
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

// The group's share of the choice.
fn group_probability() -> f32 {
    return 1.0 / f32(frame.light_groups);
}

fn spot_factor(light: Light, away: vec3<f32>) -> f32 {
    if (light.kind & LIGHT_SPOT) == 0u {
        return 1.0;
    }
    let f = clamp((dot(away, light.axis) - light.cos_outer) * light.cone_scale, 0.0, 1.0);
    return f * f;
}

// Nearest entry of the ray into spherical light `index`, or -1 (light leaves outwards only: from inside, nothing is
// seen of it). The distance of the centre from the ray is computed
// from the vector between them, which keeps small and distant spheres apart from their rounding errors.
fn intersect_sphere(origin: vec3<f32>, direction: vec3<f32>, index: u32) -> f32 {
    let light = lights[index];
    let to_centre = light.position - origin;
    let along = dot(to_centre, direction);
    let aside = to_centre - along * direction;
    let inside = light.radius * light.radius - dot(aside, aside);
    if inside < 0.0 {
        return -1.0;
    }
    return along - sqrt(inside);
}

// A spot's cone dims its whole sphere alike, by the direction from the centre to the viewer.
fn sphere_radiance(index: u32, viewer: vec3<f32>) -> vec3<f32> {
    let light = lights[index];
    return light.strength * spot_factor(light, normalize(viewer - light.position));
}

// 1 - cos of the half-angle under which a sphere is seen from outside it; 0 inside.
fn sphere_cap(light: Light, origin: vec3<f32>) -> f32 {
    let v = light.position - origin;
    let sin2 = light.radius * light.radius / max(dot(v, v), 1e-37);
    if sin2 >= 1.0 {
        return 0.0;
    }
    // sin² / (1 + cos) does not cancel for distant spheres.
    return sin2 / (1.0 + sqrt(1.0 - sin2));
}

fn frame_around(n: vec3<f32>) -> mat3x3<f32> {
    // Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3<f32>(
        vec3<f32>(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3<f32>(b, s + n.y * n.y * a, -n.y),
        n,
    );
}

// A direction in the cap 1 - cos <= `cap` around `axis`.
fn sample_cap(axis: vec3<f32>, cap: f32, u: vec2<f32>) -> vec3<f32> {
    let lift = cap * u.x;
    let sin_theta = sqrt(max(lift * (2.0 - lift), 0.0));
    let phi = 2.0 * PI * u.y;
    return normalize(frame_around(axis) * vec3<f32>(sin_theta * cos(phi), sin_theta * sin(phi), 1.0 - lift));
}

fn sample_triangle_light(p: vec3<f32>, light: Light, probability: f32, u: vec2<f32>) -> LightSample {
    let tri = triangles[light.prim];
    let m = materials[tri.material];
    let root = sqrt(u.x);
    let bary = vec2<f32>(root * (1.0 - u.y), root * u.y);
    let e1 = tri.v1 - tri.v0;
    let e2 = tri.v2 - tri.v0;
    let to_light = (tri.v0 - p) + bary.x * e1 + bary.y * e2;
    let distance = length(to_light);
    var s = no_light();
    s.direction = to_light / distance;
    s.distance = distance;
    let cosine = -dot(light.axis, s.direction);
    let pdf = probability * distance * distance / (light.radius * abs(cosine));
    // Beside the plane, and on the triangle itself, there is nothing to see. NaN is not below anything.
    if !(distance > 0.0 && pdf < 3.0e38) || (cosine <= 0.0 && (m.flags & DOUBLE_SIDED) == 0u) {
        return no_light();
    }
    s.radiance = emissive_at(light.prim, bary, m);
    s.pdf = pdf;
    // A ray meets the plane where its numerator and denominator say, each off by a few roundings of the vertices'
    // distance: slantwise, that is 1 / cosine as far along the ray.
    let error = 1e-6 * (distance + max(length(e1), length(e2)));
    s.reach = 1.0 - min(error / (distance * abs(cosine)), 1.0);
    return s;
}

fn sample_local_light(p: vec3<f32>, index: u32, probability: f32, u: vec2<f32>) -> LightSample {
    let light = lights[index];
    let to_light = light.position - p;
    let distance2 = max(dot(to_light, to_light), 1e-37);
    let axis = to_light * inverseSqrt(distance2);
    var s = no_light();
    if light.radius <= 0.0 {
        s.direction = axis;
        s.distance = sqrt(distance2);
        s.radiance = light.strength * spot_factor(light, -axis) / distance2;
        s.pdf = probability;
        s.is_delta = true;
        return s;
    }
    let cap = sphere_cap(light, p);
    if cap <= 0.0 {
        return s;
    }
    s.direction = sample_cap(axis, cap, u);
    s.distance = intersect_sphere(p, s.direction, index);
    if s.distance <= 0.0 {
        // The rim, missed by rounding.
        s.distance = sqrt(max(distance2 - light.radius * light.radius, 0.0));
    }
    s.radiance = light.strength * spot_factor(light, -axis);
    s.pdf = probability / (2.0 * PI * cap);
    s.sphere = index;
    return s;
}

fn sample_directional_light(choice: vec2<f32>, u: vec2<f32>) -> LightSample {
    let count = frame.directional_lights;
    var index = frame.local_lights + min(u32(choice.y * f32(count)), count - 1u);
    index = select(lights[index].alias_, index, choice.x < lights[index].keep);
    let light = lights[index];
    var s = no_light();
    // A disc has the given irradiance, whatever its size. It is no part of the sky: neither camera nor bounces see it.
    s.direction = light.position;
    if light.radius > 0.0 {
        s.direction = sample_cap(light.position, light.radius, u);
    }
    s.distance = 3.0e38;
    s.radiance = light.strength;
    s.pdf = group_probability() * light.pick;
    s.is_delta = true;
    return s;
}

fn env_texel(x: i32, y: i32) -> vec3<f32> {
    let w = i32(frame.env_width);
    let column = select(x % w, x % w + w, x % w < 0);
    return textureLoad(env_map, vec2<i32>(column, clamp(y, 0, i32(frame.env_height) - 1)), 0).rgb;
}

// Angle of (x, y), -pi to pi, to f32 rounding. The built-in atan2 and acos may be off by 4096 ulp, and on software
// drivers are: enough to take a direction for one of the next cell, with that cell's density.
fn angle_of(y: f32, x: f32) -> f32 {
    let ax = abs(x);
    let ay = abs(y);
    let ratio = min(ax, ay) / max(max(ax, ay), 1e-37);
    // atan(ratio) / ratio in ratio squared, interpolated at 9 Chebyshev nodes; off by less than 1e-8.
    let t = ratio * ratio;
    var p = 0.0027662835;
    p = p * t - 0.0157312491;
    p = p * t + 0.0421376236;
    p = p * t - 0.0745685483;
    p = p * t + 0.106183706;
    p = p * t - 0.141977978;
    p = p * t + 0.19991872;
    p = p * t - 0.333330367;
    p = p * t + 0.999999982;
    var angle = ratio * p;
    angle = select(angle, 0.5 * PI - angle, ay > ax);
    angle = select(angle, PI - angle, x < 0.0);
    return select(angle, -angle, y < 0.0);
}

fn env_uv(direction: vec3<f32>) -> vec2<f32> {
    let u = 0.5 + angle_of(direction.x, -direction.z) / (2.0 * PI) + frame.env_rotation;
    return vec2<f32>(u - floor(u), angle_of(length(direction.xz), direction.y) / PI);
}

fn environment(direction: vec3<f32>) -> vec3<f32> {
    if !HAS_ENV_MAP || frame.env_width == 0u {
        return frame.env_radiance;
    }
    let at = env_uv(direction) * vec2<f32>(f32(frame.env_width), f32(frame.env_height)) - 0.5;
    let base = floor(at);
    let f = at - base;
    let b = vec2<i32>(base);
    let top = mix(env_texel(b.x, b.y), env_texel(b.x + 1, b.y), f.x);
    let bottom = mix(env_texel(b.x, b.y + 1), env_texel(b.x + 1, b.y + 1), f.x);
    return mix(top, bottom, f.y);
}

// Density of the environment's grid at column `x`, which wraps, and row `y`, which is clamped.
fn env_density(x: u32, y: u32) -> f32 {
    let column = select(x, 0u, x >= frame.env_grid_width);
    return env_cells[min(y, frame.env_grid_height - 1u) * frame.env_grid_width + column].density;
}

// Densities at the corners of patch (x, y): above left, above right, below left, below right.
fn env_patch(x: u32, y: u32) -> vec4<f32> {
    let above = select(y - 1u, 0u, y == 0u);
    return vec4<f32>(env_density(x, above), env_density(x + 1u, above), env_density(x, y), env_density(x + 1u, y));
}

// Density with which `sample_light` takes the direction to the environment.
fn env_light_pdf(direction: vec3<f32>) -> f32 {
    if frame.env_grid_width == 0u {
        return 0.0;
    }
    let size = vec2<f32>(f32(frame.env_grid_width), f32(frame.env_grid_height));
    let at = env_uv(direction) * size + vec2<f32>(size.x - 0.5, 0.5);
    let base = floor(at);
    let f = at - base;
    let corners = env_patch(u32(base.x) % max(frame.env_grid_width, 1u), min(u32(base.y), frame.env_grid_height));
    let density = mix(mix(corners.x, corners.y, f.x), mix(corners.z, corners.w, f.x), f.y);
    let sin_theta = length(direction.xz);
    return group_probability() * density / max(2.0 * PI * PI * sin_theta, 1e-12);
}

// Where a number in [0, 1) falls under a density that runs linearly from `a` to `b`.
fn sample_linear(u: f32, a: f32, b: f32) -> f32 {
    return min(u * (a + b) / max(a + sqrt(mix(a * a, b * b, u)), 1e-37), 0x1.fffffep-1);
}

fn sample_env_map(choice: vec2<f32>, u: vec2<f32>) -> LightSample {
    // A number for rows and one for columns: one alone has too few digits for all patches. What remains of both
    // decides on the alias.
    let width = max(frame.env_grid_width, 1u);
    let height = frame.env_grid_height;
    let scaled = choice * vec2<f32>(f32(width), f32(height + 1u));
    let column = min(u32(scaled.x), width - 1u);
    let row = min(u32(scaled.y), height);
    let rest = scaled - vec2<f32>(f32(column), f32(row));
    var patch_ = row * width + column;
    let entry = env_cells[patch_];
    let keep = fract(rest.x + rest.y * 0x1p-11);
    patch_ = select(entry.alias_, patch_, keep < entry.keep);
    let x = patch_ % width;
    let y = patch_ / width;
    let corners = env_patch(x, y);
    // Half of a patch at a pole lies beyond it.
    var down = sample_linear(u.y, corners.x + corners.y, corners.z + corners.w);
    down = select(down, 0.5 + 0.5 * u.y, y == 0u);
    down = select(down, 0.5 * u.y, y == height);
    let across = sample_linear(u.x, mix(corners.x, corners.z, down), mix(corners.y, corners.w, down));
    let uv = vec2<f32>((f32(x) + across + 0.5) / f32(width), (f32(y) + down - 0.5) / f32(height));
    let phi = 2.0 * PI * (uv.x - frame.env_rotation - 0.5);
    let theta = PI * uv.y;
    var s = no_light();
    s.direction = vec3<f32>(sin(theta) * sin(phi), cos(theta), -sin(theta) * cos(phi));
    s.distance = 3.0e38;
    s.radiance = environment(s.direction);
    s.pdf = env_light_pdf(s.direction);
    return s;
}

// Whether there is any light to pick.
fn has_lights() -> bool {
    return (HAS_EMISSIVE || HAS_LOCAL_LIGHTS || HAS_DIRECTIONAL || HAS_ENV_MAP) && frame.light_groups > 0u;
}

// Light that may reach point `p` on the side of the unit vector `n`; on either side if that is zero.
fn sample_light(p: vec3<f32>, n: vec3<f32>, choice: vec2<f32>, u: vec2<f32>) -> LightSample {
    // The k-th group that is not empty.
    let scaled = choice.x * f32(frame.light_groups);
    var k = min(u32(scaled), frame.light_groups - 1u);
    let rest = vec2<f32>(scaled - f32(k), choice.y);
    if (HAS_EMISSIVE || HAS_LOCAL_LIGHTS) && frame.local_lights > 0u {
        if k == 0u {
            let pick = pick_from_tree(p, n, rest);
            if pick.probability <= 0.0 {
                return no_light();
            }
            let probability = pick.probability * group_probability();
            if HAS_EMISSIVE && (!HAS_LOCAL_LIGHTS || lights[pick.light].kind == LIGHT_TRIANGLE) {
                return sample_triangle_light(p, lights[pick.light], probability, u);
            }
            if HAS_LOCAL_LIGHTS {
                return sample_local_light(p, pick.light, probability, u);
            }
        }
        k -= 1u;
    }
    if HAS_DIRECTIONAL && frame.directional_lights > 0u {
        if k == 0u {
            return sample_directional_light(rest, u);
        }
    }
    if HAS_ENV_MAP {
        return sample_env_map(rest, u);
    }
    return no_light();
}

// Densities with which `sample_light` at `p`, `n` takes the direction to what a ray has just hit: triangle `prim` at
// distance `t` along `direction`, or spherical light `index`.

fn triangle_light_pdf(p: vec3<f32>, n: vec3<f32>, prim: u32, t: f32, direction: vec3<f32>) -> f32 {
    let light = lights[triangles[prim].light];
    let cosine = max(abs(dot(light.axis, direction)), 1e-37);
    return group_probability() * tree_probability(p, n, light.trail) * t * t / (light.radius * cosine);
}

fn sphere_pdf(p: vec3<f32>, n: vec3<f32>, index: u32) -> f32 {
    let light = lights[index];
    let cap = sphere_cap(light, p);
    if cap <= 0.0 {
        return 0.0;
    }
    return group_probability() * tree_probability(p, n, light.trail) / (2.0 * PI * cap);
}
