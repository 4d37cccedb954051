// Paths: next-event estimation and bounces, joined by multiple importance sampling with the balance heuristic
// (Veach 1997), on surfaces that light reaches the eye from through at most `frame.reflections` reflections.

override HAS_CONSTANT_ENV: bool = true;

struct PathSample {
    // Light reflected by the first surface, divided by its albedo.
    irradiance: vec3<f32>,
    rays: u32,
}

// The first surface's emission, or what lies behind it all.
struct FirstHit {
    hit: Hit,
    surface: Surface,
    emission: vec3<f32>,
    albedo: vec3<f32>,
}

fn first_hit(hit: Hit, view: u32, direction: vec3<f32>) -> FirstHit {
    var f: FirstHit;
    f.hit = hit;
    f.albedo = vec3<f32>(0.0);
    if hit.prim == NO_PRIM {
        f.emission = environment(direction);
    } else if (hit.prim & SPHERE) != 0u {
        f.emission = vec3<f32>(0.0);
        if HAS_SPHERES {
            f.emission = sphere_radiance(hit.prim & ~SPHERE, frame.views[view].origin);
        }
    } else {
        f.surface = surface_at(hit.prim, hit.bary, direction);
        f.emission = f.surface.emission;
        f.albedo = f.surface.albedo;
    }
    return f;
}

// Light that reaches the surface straight from a sampled light, through its Lambertian response.
fn direct_light(s: Surface, rng: ptr<function, Rng>, is_last: bool, rays: ptr<function, u32>) -> vec3<f32> {
    let choice = random2(rng);
    let u = random2(rng);
    let light = sample_light(s.position, s.normal, choice, u);
    if !(light.pdf > 0.0) {
        return vec3<f32>(0.0);
    }
    let response = diffuse_response(s, light.direction);
    if response <= 0.0 {
        return vec3<f32>(0.0);
    }
    *rays += 1u;
    if is_light_hidden(leave(s, light.direction), s.position, light, alpha_key(*rng)) {
        return vec3<f32>(0.0);
    }
    // The last surface's bounce is not followed, so light sampling stands alone there. An environment image is: its
    // bounce ray is cheap.
    var weight = 1.0;
    if !light.is_delta && !(is_last && light.distance < 1.0e38) {
        weight = light.pdf / (light.pdf + response);
    }
    return light.radiance * (response * weight / light.pdf);
}

fn clamp_indirect(c: vec3<f32>) -> vec3<f32> {
    let peak = max(max(c.r, c.g), c.b);
    return select(c, c * (frame.indirect_clamp / peak), frame.indirect_clamp > 0.0 && peak > frame.indirect_clamp);
}

// Light found by a bounce that left the surface `s` with density `pdf`.
fn found_light(s: Surface, direction: vec3<f32>, hit: Hit, emission: vec3<f32>, pdf: f32) -> vec3<f32> {
    var light_pdf = 0.0;
    if (hit.prim & SPHERE) != 0u {
        light_pdf = sphere_pdf(s.position, s.normal, hit.prim & ~SPHERE);
    } else {
        light_pdf = triangle_light_pdf(s.position, s.normal, hit.prim, hit.t, direction);
    }
    return emission * (pdf / (pdf + light_pdf));
}

fn escaped_light(direction: vec3<f32>, pdf: f32) -> vec3<f32> {
    if HAS_ENV_MAP && frame.env_width > 0u {
        return environment(direction) * (pdf / (pdf + env_light_pdf(direction)));
    }
    return frame.env_radiance;
}

fn trace_path(first: Surface, rng: ptr<function, Rng>) -> PathSample {
    var result = PathSample(vec3<f32>(0.0), 0u);
    var s = first;
    var throughput = vec3<f32>(1.0);
    var rays = 0u;
    for (var depth = 1u; depth <= frame.reflections; depth += 1u) {
        let is_last = depth == frame.reflections;
        if has_lights() {
            let direct = throughput * direct_light(s, rng, is_last, &rays);
            result.irradiance += select(clamp_indirect(direct), direct, depth == 1u);
        }
        let direction = sample_cosine(s.normal, random2(rng));
        let pdf = max(dot(direction, s.normal), 0.0) / PI;
        if dot(direction, s.geometric_normal) <= 0.0 || pdf <= 0.0 {
            break;
        }
        let origin = leave(s, direction);
        let key = alpha_key(*rng);
        if is_last {
            // Only light from infinity is still to be found: whether the way is free says it all.
            if HAS_CONSTANT_ENV || HAS_ENV_MAP {
                rays += 1u;
                if !is_occluded(origin, direction, 3.0e38, NO_LIGHT, key) {
                    let found = throughput * escaped_light(direction, pdf);
                    result.irradiance += select(clamp_indirect(found), found, depth == 1u);
                }
            }
            break;
        }
        rays += 1u;
        let hit = trace_closest(origin, direction, key);
        if hit.prim == NO_PRIM {
            if HAS_CONSTANT_ENV || HAS_ENV_MAP {
                let found = throughput * escaped_light(direction, pdf);
                result.irradiance += select(clamp_indirect(found), found, depth == 1u);
            }
            break;
        }
        if HAS_SPHERES && (hit.prim & SPHERE) != 0u {
            let found = throughput * found_light(s, direction, hit, sphere_radiance(hit.prim & ~SPHERE, s.position), pdf);
            result.irradiance += select(clamp_indirect(found), found, depth == 1u);
            break;
        }
        let next = surface_at(hit.prim, hit.bary, direction);
        if HAS_EMISSIVE {
            if any(next.emission > vec3<f32>(0.0)) {
                let found = throughput * found_light(s, direction, hit, next.emission, pdf);
                result.irradiance += select(clamp_indirect(found), found, depth == 1u);
            }
        }
        s = next;
        throughput *= s.albedo;
        // Russian roulette after the third bounce.
        let survive = min(max(max(throughput.r, throughput.g), throughput.b), 0.95);
        if survive <= 0.0 {
            break;
        }
        if depth >= 3u {
            if random2(rng).x >= survive {
                break;
            }
            throughput /= survive;
        }
    }
    result.rays = rays;
    return result;
}
