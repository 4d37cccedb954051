// Light sampling. There are three groups: local lights (emissive triangles, points, spots and spheres), directional
// lights, and an environment image. Nonempty groups are equally likely. The light tree picks a local light by its
// importance to the point (Conty Estevez & Kulla 2018, see `emitters/light_tree.rs`). An alias table (Walker 1977)
// picks a directional light in proportion to its irradiance. A constant environment is not sampled as a light:
// cosine-weighted bounces find it with less noise. At the first vertex of a path (`is_first`), lights with hard shadows
// are left out if `hard_light` (see `path`) computes their light.

//!include frame math tables scene light_tree light_groups environment surface

override HAS_LOCAL_LIGHTS: bool = true;
override HAS_DIRECTIONAL: bool = true;
// Whether emissive triangles are masked or blended, and whether some are under a clear coat.
override HAS_ALPHA_EMITTERS: bool = true;
override HAS_COATED_EMITTERS: bool = true;

fn spot_factor(light: Light, away: vec3<f32>) -> f32 {
    if (light.kind & LIGHT_SPOT) == 0u {
        return 1.0;
    }
    let f = clamp((dot(away, light.axis) - light.cos_outer) * light.cone_scale, 0.0, 1.0);
    return f * f;
}

// Distance at which the ray enters spherical light `index`; negative if it misses. From inside the sphere it is
// negative too, which is right since spheres emit outwards only. The centre's distance from the ray is computed from
// the vector between them, which stays exact for small and distant spheres.
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

// Radiance of a spherical light. A spot's cone dims the whole sphere uniformly, by the direction from the centre to the
// viewer.
fn sphere_radiance(index: u32, viewer: vec3<f32>) -> vec3<f32> {
    let light = stored_light(index);
    return light.strength * spot_factor(light, normalize(viewer - light.position));
}

// 1 - cos of the half-angle that a sphere subtends; 0 from inside.
fn sphere_cap(light: Light, origin: vec3<f32>) -> f32 {
    let v = light.position - origin;
    let sin2 = light.radius * light.radius / max(dot(v, v), 1e-37);
    if sin2 >= 1.0 {
        return 0.0;
    }
    // sin² / (1 + cos) does not cancel for distant spheres.
    return sin2 / (1.0 + sqrt(1.0 - sin2));
}

// Samples a direction in the cap 1 - cos <= `cap` around `axis`.
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
    // Edge-on, and on the triangle itself, no light is visible.
    if !(is_within(distance, MOST_FLOAT) && is_within(pdf, MOST_FLOAT)) || (cosine <= 0.0 && (m.flags & DOUBLE_SIDED) == 0u) {
        return no_light();
    }
    s.radiance = emissive_at(light.prim, bary, m);
    if HAS_COATED_EMITTERS {
        s.radiance = surface_at(light.prim, bary, p, s.direction).emission;
    }
    // The coverage is the probability with which a scattered ray hits the triangle at this point. Scaled by it, light
    // sampling has the same mean as scattered rays, so MIS weights only need the densities of directions.
    if HAS_ALPHA_EMITTERS {
        s.radiance *= coverage_at(light.prim, bary, m);
    }
    s.pdf = pdf;
    // Numerator and denominator of the intersection with the plane are each off by a few roundings of the vertices'
    // distance. At an angle, the error along the ray grows by 1 / cosine.
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
        // Rounding made the ray miss the rim.
        s.distance = sqrt(max(distance2 - light.radius * light.radius, 0.0));
    }
    s.radiance = light.strength * spot_factor(light, -axis);
    s.pdf = probability / (2.0 * PI * cap);
    s.sphere = index;
    return s;
}

fn sample_directional_light(choice: vec2<f32>, probability: f32, u: vec2<f32>) -> LightSample {
    let count = frame.lights.directional_count;
    var index = frame.lights.local_count + min(u32(choice.y * f32(count)), count - 1u);
    index = select(stored_light(index).alias_index, index, choice.x < stored_light(index).keep);
    return sample_sun(index, probability * stored_light(index).pick, u);
}

// Samples directional light `index`, which was picked with this probability.
fn sample_sun(index: u32, probability: f32, u: vec2<f32>) -> LightSample {
    let light = stored_light(index);
    var s = no_light();
    // A disc yields the given irradiance, whatever its size. It is not part of the sky: neither camera nor bounces see
    // it.
    s.direction = light.position;
    if light.radius > 0.0 {
        s.direction = sample_cap(light.position, light.radius, u);
    }
    s.distance = 3.0e38;
    s.radiance = light.strength;
    s.pdf = probability;
    s.is_delta = true;
    return s;
}

// Whether there is any light to sample.
fn has_lights(is_first: bool) -> bool {
    return (HAS_EMISSIVE || HAS_LOCAL_LIGHTS || HAS_DIRECTIONAL || HAS_ENV_MAP) && group_count(is_first) > 0u;
}

// Whether local light `index` has hard shadows.
fn is_hard(index: u32) -> bool {
    return index - frame.lights.first_hard < frame.lights.hard_count;
}

// Samples light that may reach point `p` on the side of the unit vector `n`, or on either side if `n` is zero.
fn sample_light(p: vec3<f32>, n: vec3<f32>, choice: vec2<f32>, u: vec2<f32>, is_first: bool) -> LightSample {
    // Pick the k-th group.
    let scaled = choice.x * f32(group_count(is_first));
    var k = min(u32(scaled), group_count(is_first) - 1u);
    let rest = vec2<f32>(scaled - f32(k), choice.y);
    if (HAS_EMISSIVE || HAS_LOCAL_LIGHTS) && samples_local(is_first) {
        if k == 0u {
            let pick = pick_from_tree(p, n, rest);
            if pick.probability <= 0.0 || (HAS_HARD_LIGHTS && is_first && is_hard(pick.light)) {
                return no_light();
            }
            let probability = pick.probability * group_probability(is_first);
            if HAS_EMISSIVE && (!HAS_LOCAL_LIGHTS || stored_light(pick.light).kind == LIGHT_TRIANGLE) {
                return sample_triangle_light(p, stored_light(pick.light), probability, u);
            }
            if HAS_LOCAL_LIGHTS {
                return sample_local_light(p, pick.light, probability, u);
            }
        }
        k -= 1u;
    }
    if HAS_DIRECTIONAL && samples_directional(is_first) {
        if k == 0u {
            return sample_directional_light(rest, group_probability(is_first), u);
        }
    }
    if HAS_ENV_MAP {
        return sample_env_map(rest, u, is_first);
    }
    return no_light();
}

// Densities with which `sample_light` at `p`, `n` samples the direction of a ray that has hit a light: triangle `prim`
// at distance `t` along `direction`, or spherical light `index`.

fn triangle_light_pdf(p: vec3<f32>, n: vec3<f32>, prim: u32, t: f32, direction: vec3<f32>, is_first: bool) -> f32 {
    let light = stored_light(stored_triangle(prim).light);
    let cosine = max(abs(dot(light.axis, direction)), 1e-37);
    return group_probability(is_first) * tree_probability(p, n, light.trail) * t * t / (light.radius * cosine);
}

fn sphere_pdf(p: vec3<f32>, n: vec3<f32>, index: u32, is_first: bool) -> f32 {
    let light = stored_light(index);
    let cap = sphere_cap(light, p);
    if cap <= 0.0 {
        return 0.0;
    }
    return group_probability(is_first) * tree_probability(p, n, light.trail) / (2.0 * PI * cap);
}
