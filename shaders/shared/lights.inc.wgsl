// Lights and how one is chosen and sampled. Groups of lights (emissive triangles, local lights, directional lights, an
// environment image) are equally likely; within a group a light is picked in proportion to its power, by an alias
// table (Walker 1977). A constant environment is no light to pick: cosine-weighted bounces find it with less noise.

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
    radius: f32,
    // Spot: axis. Directional: axis and cosine of the disc's half-angle.
    axis: vec3<f32>,
    cos_outer: f32,
    // Spot: 1 / (cos_inner - cos_outer).
    cone_scale: f32,
    // Probability of the light in its group.
    pick: f32,
    // Alias table: keep this entry with probability `keep`, else take `alias_`.
    keep: f32,
    alias_: u32,
    prim: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}
const LIGHT_SPOT: u32 = 1u;

@group(0) @binding(9) var<storage, read> lights: array<Light>;
@group(0) @binding(10) var env_map: texture_2d<f32>;
// (keep, alias, density relative to uniform over the map's (u, v) square, 0) per cell of a grid laid over the map. The
// grid has 2^17 cells, so that a 24-bit random number picks them all alike.
@group(0) @binding(11) var<storage, read> env_alias: array<vec4<f32>>;
const ENV_GRID: vec2<u32> = vec2<u32>(512u, 256u);

const GROUP_TRIANGLES: u32 = 0u;
const GROUP_LOCAL: u32 = 1u;
const GROUP_DIRECTIONAL: u32 = 2u;
const GROUP_ENV_MAP: u32 = 3u;
const NO_LIGHT: u32 = 0xffffffffu;
const PI: f32 = 3.14159265358979;

struct LightSample {
    direction: vec3<f32>,
    distance: f32,
    radiance: vec3<f32>,
    // Solid-angle density; 0: nothing sampled. Delta lights: the probability of the pick, and `is_delta`.
    pdf: f32,
    is_delta: bool,
    // Spherical light that the shadow ray must not be stopped by.
    sphere: u32,
}

fn no_light() -> LightSample {
    return LightSample(vec3<f32>(0.0, 1.0, 0.0), 0.0, vec3<f32>(0.0), 0.0, false, NO_LIGHT);
}

fn spot_factor(light: Light, away: vec3<f32>) -> f32 {
    if (light.kind & LIGHT_SPOT) == 0u {
        return 1.0;
    }
    let f = clamp((dot(away, light.axis) - light.cos_outer) * light.cone_scale, 0.0, 1.0);
    return f * f;
}

// Nearest entry of the ray into spherical light `index`, or -1. The distance of the centre from the ray is computed
// from the vector between them, which keeps small and distant spheres apart from their rounding errors.
fn intersect_sphere(origin: vec3<f32>, direction: vec3<f32>, index: u32) -> f32 {
    let light = lights[frame.group_begin.y + index];
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
    let light = lights[frame.group_begin.y + index];
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

// `u.y` takes an entry, `u.x` keeps it or not.
fn pick_light(group: u32, u: vec2<f32>) -> u32 {
    let count = frame.group_count[group];
    let index = frame.group_begin[group] + min(u32(u.y * f32(count)), count - 1u);
    let entry = lights[index];
    return select(entry.alias_, index, u.x < entry.keep);
}

fn sample_triangle_light(p: vec3<f32>, pick: vec2<f32>, u: vec2<f32>, group_pdf: f32) -> LightSample {
    let prim = lights[pick_light(GROUP_TRIANGLES, pick)].prim;
    let tri = triangles[prim];
    let m = materials[tri.material];
    let root = sqrt(u.x);
    let bary = vec2<f32>(root * (1.0 - u.y), root * u.y);
    let e1 = tri.v1 - tri.v0;
    let e2 = tri.v2 - tri.v0;
    let cross_ = cross(e1, e2);
    let area2 = length(cross_);
    let to_light = (tri.v0 - p) + bary.x * e1 + bary.y * e2;
    let distance2 = dot(to_light, to_light);
    if !(area2 > 0.0) || !(distance2 > 0.0) {
        return no_light();
    }
    let distance = sqrt(distance2);
    let direction = to_light / distance;
    let cosine = -dot(cross_, direction) / area2;
    if cosine <= 0.0 && (m.flags & DOUBLE_SIDED) == 0u {
        return no_light();
    }
    if abs(cosine) < 1e-7 {
        return no_light();
    }
    var s: LightSample;
    s.direction = direction;
    s.distance = distance * (1.0 - 1e-5);
    s.radiance = emissive_at(prim, bary, m);
    s.pdf = group_pdf * m.light_pdf * distance2 / abs(cosine);
    s.is_delta = false;
    s.sphere = NO_LIGHT;
    return s;
}

fn sample_local_light(p: vec3<f32>, pick: vec2<f32>, u: vec2<f32>, group_pdf: f32) -> LightSample {
    let index = pick_light(GROUP_LOCAL, pick);
    let light = lights[index];
    let to_light = light.position - p;
    let distance2 = max(dot(to_light, to_light), 1e-37);
    let axis = to_light * inverseSqrt(distance2);
    var s: LightSample;
    s.sphere = NO_LIGHT;
    if light.radius <= 0.0 {
        s.direction = axis;
        s.distance = sqrt(distance2);
        s.radiance = light.strength * spot_factor(light, -axis) / distance2;
        s.pdf = group_pdf * light.pick;
        s.is_delta = true;
        return s;
    }
    let cap = sphere_cap(light, p);
    if cap <= 0.0 {
        return no_light();
    }
    let sphere = index - frame.group_begin.y;
    s.direction = sample_cap(axis, cap, u);
    s.distance = intersect_sphere(p, s.direction, sphere);
    if s.distance <= 0.0 {
        // The rim, missed by rounding.
        s.distance = sqrt(max(distance2 - light.radius * light.radius, 0.0));
    }
    s.radiance = light.strength * spot_factor(light, -axis);
    s.pdf = group_pdf * light.pick / (2.0 * PI * cap);
    s.is_delta = false;
    s.sphere = sphere;
    return s;
}

fn sample_directional_light(pick: vec2<f32>, u: vec2<f32>, group_pdf: f32) -> LightSample {
    let light = lights[pick_light(GROUP_DIRECTIONAL, pick)];
    var s: LightSample;
    // `radius` holds 1 - cos of the disc's half-angle. The disc has the given irradiance, whatever its size.
    s.direction = light.position;
    if light.radius > 0.0 {
        s.direction = sample_cap(light.position, light.radius, u);
    }
    s.distance = 3.0e38;
    s.radiance = light.strength;
    s.pdf = group_pdf * light.pick;
    s.is_delta = true;
    s.sphere = NO_LIGHT;
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

// Density of `sample_env_map` over solid angle.
fn env_pdf(direction: vec3<f32>) -> f32 {
    let cell = min(vec2<u32>(env_uv(direction) * vec2<f32>(ENV_GRID)), ENV_GRID - 1u);
    let sin_theta = sqrt(max(1.0 - direction.y * direction.y, 0.0));
    return env_alias[cell.y * ENV_GRID.x + cell.x].z / max(2.0 * PI * PI * sin_theta, 1e-12);
}

fn sample_env_map(pick: vec2<f32>, u: vec2<f32>, group_pdf: f32) -> LightSample {
    var cell = u32(pick.y * f32(ENV_GRID.x * ENV_GRID.y));
    let entry = env_alias[cell];
    if pick.x >= entry.x {
        cell = u32(entry.y);
    }
    let uv = (vec2<f32>(f32(cell % ENV_GRID.x), f32(cell / ENV_GRID.x)) + u) / vec2<f32>(ENV_GRID);
    let phi = 2.0 * PI * (uv.x - frame.env_rotation - 0.5);
    let theta = PI * uv.y;
    var s: LightSample;
    s.direction = vec3<f32>(sin(theta) * sin(phi), cos(theta), -sin(theta) * cos(phi));
    s.distance = 3.0e38;
    s.radiance = environment(s.direction);
    s.pdf = group_pdf * env_pdf(s.direction);
    s.is_delta = false;
    s.sphere = NO_LIGHT;
    return s;
}

// Whether there is any light to pick.
fn has_lights() -> bool {
    return (HAS_EMISSIVE || HAS_LOCAL_LIGHTS || HAS_DIRECTIONAL || HAS_ENV_MAP) && frame.light_groups > 0u;
}

fn sample_light(p: vec3<f32>, choice: vec2<f32>, u: vec2<f32>) -> LightSample {
    // The k-th group that is not empty.
    let scaled = choice.x * f32(frame.light_groups);
    var k = min(u32(scaled), frame.light_groups - 1u);
    let pick = vec2<f32>(scaled - f32(k), choice.y);
    let group_pdf = 1.0 / f32(frame.light_groups);
    if HAS_EMISSIVE && frame.group_count.x > 0u {
        if k == 0u {
            return sample_triangle_light(p, pick, u, group_pdf);
        }
        k -= 1u;
    }
    if HAS_LOCAL_LIGHTS && frame.group_count.y > 0u {
        if k == 0u {
            return sample_local_light(p, pick, u, group_pdf);
        }
        k -= 1u;
    }
    if HAS_DIRECTIONAL && frame.group_count.z > 0u {
        if k == 0u {
            return sample_directional_light(pick, u, group_pdf);
        }
    }
    if HAS_ENV_MAP {
        return sample_env_map(pick, u, group_pdf);
    }
    return no_light();
}

// Density with which `sample_light` at `p` takes the direction to the sphere just hit.
fn sphere_pdf(p: vec3<f32>, index: u32) -> f32 {
    let light = lights[frame.group_begin.y + index];
    let cap = sphere_cap(light, p);
    return select(0.0, light.pick / (2.0 * PI * cap * f32(frame.light_groups)), cap > 0.0);
}
