// Lights and how one is chosen and sampled. There are three groups: lights that are somewhere (emissive triangles,
// points, spots and spheres), directional lights, and an environment image. Groups that are not empty are equally
// likely. In the first, a tree of lights leads to one by what it may bring to the point (Conty Estevez & Kulla 2018,
// see `emitters/light_tree.rs`); directional lights are picked in proportion to their irradiance, by an alias table
// (Walker 1977). A constant environment is no light to pick: cosine-weighted bounces find it with less noise.

override HAS_EMISSIVE: bool = true;
override HAS_LOCAL_LIGHTS: bool = true;
override HAS_DIRECTIONAL: bool = true;
// Emissive triangles that are masked or blended, and such under a coat.
override HAS_ALPHA_EMITTERS: bool = true;
override HAS_COATED_EMITTERS: bool = true;

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

// The group's share of the choice.
fn group_probability() -> f32 {
    return 1.0 / f32(frame.lights.group_count);
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
    let light = stored_light(index);
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
    let light = stored_light(index);
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
    let tri = stored_triangle(light.prim);
    let m = stored_material(tri.material);
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
    // Beside the plane, and on the triangle itself, there is nothing to see.
    if !(is_within(distance, MOST_FLOAT) && is_within(pdf, MOST_FLOAT)) || (cosine <= 0.0 && (m.flags & DOUBLE_SIDED) == 0u) {
        return no_light();
    }
    s.radiance = emissive_at(light.prim, bary, m);
    if HAS_COATED_EMITTERS {
        s.radiance = surface_at(light.prim, bary, p, s.direction).emission;
    }
    // A scattered ray meets the triangle there with this probability, so both ways to the light have one mean, and the
    // weights that join them need no more than the densities of directions.
    if HAS_ALPHA_EMITTERS {
        s.radiance *= coverage_at(light.prim, bary, m);
    }
    s.pdf = pdf;
    // A ray meets the plane where its numerator and denominator say, each off by a few roundings of the vertices'
    // distance: slantwise, that is 1 / cosine as far along the ray.
    let error = 1e-6 * (distance + max(length(e1), length(e2)));
    s.reach = 1.0 - min(error / (distance * abs(cosine)), 1.0);
    return s;
}

fn sample_local_light(p: vec3<f32>, index: u32, probability: f32, u: vec2<f32>) -> LightSample {
    let light = stored_light(index);
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
    let count = frame.lights.directional_count;
    var index = frame.lights.local_count + min(u32(choice.y * f32(count)), count - 1u);
    index = select(stored_light(index).alias_index, index, choice.x < stored_light(index).keep);
    let light = stored_light(index);
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

// Whether there is any light to pick.
fn has_lights() -> bool {
    return (HAS_EMISSIVE || HAS_LOCAL_LIGHTS || HAS_DIRECTIONAL || HAS_ENV_MAP) && frame.lights.group_count > 0u;
}

// Light that may reach point `p` on the side of the unit vector `n`; on either side if that is zero.
fn sample_light(p: vec3<f32>, n: vec3<f32>, choice: vec2<f32>, u: vec2<f32>) -> LightSample {
    // The k-th group that is not empty.
    let scaled = choice.x * f32(frame.lights.group_count);
    var k = min(u32(scaled), frame.lights.group_count - 1u);
    let rest = vec2<f32>(scaled - f32(k), choice.y);
    if (HAS_EMISSIVE || HAS_LOCAL_LIGHTS) && frame.lights.local_count > 0u {
        if k == 0u {
            let pick = pick_from_tree(p, n, rest);
            if pick.probability <= 0.0 {
                return no_light();
            }
            let probability = pick.probability * group_probability();
            if HAS_EMISSIVE && (!HAS_LOCAL_LIGHTS || stored_light(pick.light).kind == LIGHT_TRIANGLE) {
                return sample_triangle_light(p, stored_light(pick.light), probability, u);
            }
            if HAS_LOCAL_LIGHTS {
                return sample_local_light(p, pick.light, probability, u);
            }
        }
        k -= 1u;
    }
    if HAS_DIRECTIONAL && frame.lights.directional_count > 0u {
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
    let light = stored_light(stored_triangle(prim).light);
    let cosine = max(abs(dot(light.axis, direction)), 1e-37);
    return group_probability() * tree_probability(p, n, light.trail) * t * t / (light.radius * cosine);
}

fn sphere_pdf(p: vec3<f32>, n: vec3<f32>, index: u32) -> f32 {
    let light = stored_light(index);
    let cap = sphere_cap(light, p);
    if cap <= 0.0 {
        return 0.0;
    }
    return group_probability() * tree_probability(p, n, light.trail) / (2.0 * PI * cap);
}
