// Path tracing with at most `Sampling::reflections` reflections: next-event estimation and bounces, combined by
// multiple importance sampling with the balance heuristic (Veach 1997). Paths may end in the radiance cache.

//!include frame rng math tables scene environment lights trace hits surface bsdf path cache

// Whether smooth lobes behind a wide bounce are made rougher.
override IS_REGULARIZED: bool = false;

// Density of a bounce, per steradian, above which it counts as narrow. A Lambertian bounce has at most 1/π.
const NARROW_PDF: f32 = 1.0;
// Minimum GGX width behind a wide bounce, at one sample per pixel.
const REGULARIZED_ALPHA: f32 = 0.2;

struct PathSample {
    // Light reflected towards the viewer by the first surface, without its own emission. If it is split, `radiance` is
    // the Lambertian lobe's part and `gloss` the facets'.
    radiance: vec3<f32>,
    gloss: vec3<f32>,
    rays: u32,
    // Record for the radiance cache.
    record: vec3<u32>,
}

fn clamp_indirect(c: vec3<f32>, most: f32) -> vec3<f32> {
    let peak = max3(c);
    return select(c, c * (most / peak), most > 0.0 && peak > most);
}

// Density with which light sampling at `p` samples the direction to the light that a scattered ray has hit.
fn found_light_pdf(p: vec3<f32>, n: vec3<f32>, direction: vec3<f32>, hit: Hit, is_first: bool) -> f32 {
    if (hit.prim & SPHERE) != 0u {
        return sphere_pdf(p, n, hit.prim & ~SPHERE, is_first);
    }
    if HAS_UNLIT && (stored_material(stored_triangle(hit.prim).material).flags & UNLIT) != 0u {
        return 0.0;
    }
    return triangle_light_pdf(p, n, hit.prim, hit.t, direction, is_first);
}

fn escaped_light(direction: vec3<f32>, b: BsdfSample, is_first: bool) -> vec3<f32> {
    if HAS_ENV_MAP && frame.environment.width > 0u {
        return environment(direction) * select(b.pdf / (b.pdf + env_light_pdf(direction, is_first)), 1.0, b.is_delta);
    }
    return frame.environment.radiance;
}

// Makes the lobes of a surface behind a wide bounce rougher: such a bounce finds a narrow lobe that shows a lamp rarely,
// and the light of that sample is bright (Kaplanyan & Dachsbacher, "Path Space Regularization for Holistic and Robust
// Light Transport", 2013). As there, the width shrinks with the number of samples, so that the bias vanishes. Panes stay
// clear.
fn regularize(s: ptr<function, Surface>, is_wide: bool, samples: u32) {
    let is_pane = HAS_TRANSMISSION && (*s).is_thin && max3((*s).transmitted) > 0.0;
    if is_wide && !is_pane {
        let least = REGULARIZED_ALPHA * pow(f32(samples), -1.0 / 6.0);
        (*s).alpha = max((*s).alpha, least);
        (*s).coat_alpha = max((*s).coat_alpha, least);
        if HAS_ANISOTROPY {
            (*s).alpha_along = max((*s).alpha_along, least);
        }
    }
}

fn gather(into: ptr<function, PathSample>, light: vec3<f32>, share: vec3<f32>) {
    if is_split() {
        (*into).radiance += light * share;
        (*into).gloss += light * (1.0 - share);
    } else {
        (*into).radiance += light;
    }
}

fn all_light(path: PathSample) -> vec3<f32> {
    return path.radiance + path.gloss;
}

// Traces a path from the first surface of a pixel. The ray along `direction_in` arrived there through `medium_in`, over
// `links` mirrors and glass surfaces, which count as reflections. `recording` says what the path records for the radiance
// cache.
fn trace_path(first: Surface, direction_in: vec3<f32>, medium_in: Medium, sampling: Sampling, links: u32, recording: u32, rng: ptr<function, Rng>) -> PathSample {
    var result = PathSample();
    var cache_path = CachePath();
    cache_path.recording = recording;
    var s = first;
    var v = -direction_in;
    var medium = medium_in;
    var throughput = vec3<f32>(1.0);
    var rays = 0u;
    var share = vec3<f32>(1.0);
    var is_wide = false;
    for (var depth = links + 1u; depth <= sampling.reflections; depth += 1u) {
        let is_first = depth == links + 1u;
        let is_last = depth == sampling.reflections;
        if HAS_DISPERSION {
            s.colors = throughput / max(throughput.r + throughput.g + throughput.b, 1e-30);
        }
        if has_lights(is_first) {
            let direct = throughput * direct_light(s, v, medium, depth, is_first, rng, &rays, &share);
            gather(&result, select(clamp_indirect(direct, sampling.indirect_clamp), direct, is_first), share);
        }
        let b = sample_bsdf(s, v, random_at(rng, depth, LOBE_CHOICE).x, random_at(rng, depth, LOBE_DIRECTION));
        if !is_within(b.pdf, MOST_FLOAT) {
            break;
        }
        let direction = b.direction;
        throughput *= b.weight;
        if is_split() && is_first {
            share = select(matte_fraction(s, v, b.direction, b.weight * b.pdf), vec3<f32>(0.0), b.is_delta);
        }
        if max3(throughput) <= 0.0 {
            break;
        }
        medium = medium_towards(s, direction, medium);
        let from_ = s.position;
        let from_normal = lit_normal(s);
        let origin = leave(s, direction);
        let key = alpha_key(*rng);
        if is_last && !(HAS_EMISSIVE || HAS_SPHERES || HAS_UNLIT || HAS_CONSTANT_ENV || HAS_ENV_MAP) {
            break;
        }
        rays += 1u;
        let hit = trace_closest(origin, direction, key);
        var found = vec3<f32>(0.0);
        let is_surface = (hit.prim & SPHERE) == 0u;
        if is_surface {
            s = surface_at(hit.prim, hit.bary, origin, direction);
            if IS_REGULARIZED {
                is_wide = is_wide || (!b.is_delta && b.pdf < NARROW_PDF);
                regularize(&s, is_wide, sampling.samples.least);
            }
            if HAS_TRANSMISSION {
                medium = medium_before(s, medium);
                throughput *= transmittance(medium, hit.t);
            }
            if HAS_EMISSIVE || HAS_UNLIT {
                found = s.emission;
            }
        } else if hit.prim == NO_PRIM {
            if HAS_CONSTANT_ENV || HAS_ENV_MAP {
                found = escaped_light(direction, b, is_first);
            }
        } else if HAS_SPHERES {
            found = sphere_radiance(hit.prim & ~SPHERE, from_);
        }
        if HAS_TRANSMISSION && !is_surface {
            found *= transmittance(medium, hit.t);
        }
        if hit.prim != NO_PRIM && !b.is_delta {
            if any(found > vec3<f32>(0.0)) {
                found *= b.pdf / (b.pdf + found_light_pdf(from_, from_normal, direction, hit, is_first));
            }
        }
        found *= throughput;
        gather(&result, select(clamp_indirect(found, sampling.indirect_clamp), found, is_first), share);
        if !is_surface || is_last {
            break;
        }
        if HAS_CACHE && !medium.is_inside {
            let cached = enter_cell(&cache_path, s, b, hit.t, throughput, all_light(result), key);
            if cached.is_known {
                gather(&result, clamp_indirect(throughput * s.albedo * cached.light, sampling.indirect_clamp), share);
                break;
            }
        }
        v = -direction;
        // Russian roulette after the third bounce, by throughput over the first surface's albedo, since filters see
        // demodulated illumination.
        if depth >= 3u {
            let survive = min(max3(throughput / max(first.albedo, vec3<f32>(1e-3))), 0.95);
            if random_at(rng, depth, SURVIVAL).x >= survive {
                break;
            }
            throughput /= survive;
        }
    }
    if HAS_CACHE {
        result.record = record_of(cache_path, all_light(result));
    }
    result.rays = rays;
    return result;
}
