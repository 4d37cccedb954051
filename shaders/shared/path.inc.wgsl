// Path tracing with at most `Sampling::reflections` reflections: next-event estimation and bounces, combined by
// multiple importance sampling with the balance heuristic (Veach 1997).

override HAS_CONSTANT_ENV: bool = true;

// Whether specular light of view-dependent pixels counts as emission, so that no filter blurs it.
override HAS_NARROW_LOBES: bool = true;

// Whether smooth lobes behind a wide bounce are made rougher.
override IS_REGULARIZED: bool = false;

// Pairs of random dimensions that each vertex of a path uses. Their numbers are fixed, so that features that a scene
// lacks do not shift the others. The pair before them places the sample in its pixel.
const FIRST_DIMENSION: u32 = 1u;
const DIMENSIONS_PER_VERTEX: u32 = 5u;
const LIGHT_CHOICE: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LOBE_CHOICE: u32 = 2u;
const LOBE_DIRECTION: u32 = 3u;
const SURVIVAL: u32 = 4u;

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
}

// First hit of a primary ray. `emission` is that of the surface or, without one, of the spherical light or the
// environment.
struct FirstHit {
    hit: Hit,
    surface: Surface,
    emission: vec3<f32>,
    albedo: vec3<f32>,
    matte: vec3<f32>,
    // Fraction of the surface's light that reaches the eye, through volumes, mirrors and glass.
    transmittance: vec3<f32>,
    // Medium between the surface and the eye or the last mirror or glass before it.
    medium: Medium,
}

// Medium that a ray travels through.
struct Medium {
    absorption: vec3<f32>,
    is_inside: bool,
}

const OUTSIDE_OF_VOLUMES: Medium = Medium(vec3<f32>(0.0), false);

// Transmittance over `distance` through a medium.
fn transmittance(medium: Medium, distance: f32) -> vec3<f32> {
    return select(vec3<f32>(1.0), exp(-medium.absorption * distance), medium.is_inside);
}

// Medium in front of a surface that a ray hits in what was known as `medium`. If the ray hits a volume's surface from
// behind, it was in that volume.
fn medium_before(s: Surface, medium: Medium) -> Medium {
    if !HAS_TRANSMISSION {
        return medium;
    }
    let absorption = select(stored_material(s.material).absorption, medium.absorption, medium.is_inside);
    return Medium(absorption, medium.is_inside || !(s.is_front || s.is_thin));
}

// First hit of a ray from the eye.
fn first_hit(hit: Hit, origin: vec3<f32>, direction: vec3<f32>) -> FirstHit {
    return first_hit_in(OUTSIDE_OF_VOLUMES, hit, origin, direction);
}

// First hit of a ray in `medium`.
fn first_hit_in(medium: Medium, hit: Hit, origin: vec3<f32>, direction: vec3<f32>) -> FirstHit {
    var f: FirstHit;
    f.medium = medium;
    f.hit = hit;
    f.albedo = vec3<f32>(0.0);
    f.matte = vec3<f32>(0.0);
    f.transmittance = vec3<f32>(1.0);
    if hit.prim == NO_PRIM {
        f.emission = environment(direction);
    } else if (hit.prim & SPHERE) != 0u {
        f.emission = vec3<f32>(0.0);
        if HAS_SPHERES {
            f.emission = sphere_radiance(hit.prim & ~SPHERE, origin);
        }
    } else {
        f.surface = surface_at(hit.prim, hit.bary, origin, direction);
        if HAS_TRANSMISSION {
            f.medium = medium_before(f.surface, medium);
            f.transmittance = transmittance(f.medium, dot(f.surface.position - origin, direction));
        }
        f.emission = f.surface.emission * f.transmittance;
        f.albedo = f.surface.albedo * f.transmittance;
        f.matte = f.surface.matte * f.transmittance;
    }
    if HAS_TRANSMISSION && (hit.prim & SPHERE) != 0u {
        f.emission *= transmittance(medium, hit.t);
    }
    return f;
}

// Whether paths tell specular from diffuse light.
fn is_split() -> bool {
    return HAS_GLOSS || HAS_NARROW_LOBES;
}

fn random_at(rng: ptr<function, Rng>, depth: u32, dimension: u32) -> vec2<f32> {
    (*rng).dimension = FIRST_DIMENSION + (depth - 1u) * DIMENSIONS_PER_VERTEX + dimension;
    return random2(rng);
}

// Medium on the side of the surface that `direction` points to.
fn medium_towards(s: Surface, direction: vec3<f32>, before: Medium) -> Medium {
    if !HAS_TRANSMISSION || s.is_thin || dot(s.geometric_normal, direction) > 0.0 {
        return before;
    }
    return Medium(stored_material(s.material).absorption, s.is_front);
}

// Normal of the side from which light can be scattered to the viewer; 0 for both sides.
fn lit_normal(s: Surface) -> vec3<f32> {
    let is_translucent = max3(s.transmitted) > 0.0 || (HAS_DIFFUSE_TRANSMISSION && max3(s.through) > 0.0);
    return select(s.normal, vec3<f32>(0.0), HAS_TRANSMISSION && is_translucent);
}

// Direct light from a sampled light, scattered towards the viewer. If light is split, `share` is the Lambertian lobe's
// fraction of the light that the first surface scatters.
fn direct_light(s: Surface, v: vec3<f32>, medium: Medium, depth: u32, is_first: bool, rng: ptr<function, Rng>, rays: ptr<function, u32>, share: ptr<function, vec3<f32>>) -> vec3<f32> {
    let choice = random_at(rng, depth, LIGHT_CHOICE);
    let u = random_at(rng, depth, LIGHT_POINT);
    let light = sample_light(s.position, lit_normal(s), choice, u, is_first);
    if !is_within(light.pdf, MOST_FLOAT) {
        return vec3<f32>(0.0);
    }
    let scattered = evaluate(s, v, light.direction);
    if max3(scattered.value) <= 0.0 {
        return vec3<f32>(0.0);
    }
    if is_split() && is_first {
        *share = matte_fraction(s, v, light.direction, scattered.value);
    }
    return unoccluded(s, medium, light, scattered, alpha_key(*rng), rays);
}

// The part of a sampled light that reaches the surface unoccluded, scattered towards the viewer as `scattered` says.
fn unoccluded(s: Surface, medium: Medium, light: LightSample, scattered: Scattering, key: u32, rays: ptr<function, u32>) -> vec3<f32> {
    let visibility = light_visibility(leave(s, light.direction), s.position, light, key, rays);
    if max3(visibility) <= 0.0 {
        return vec3<f32>(0.0);
    }
    let weight = select(light.pdf / (light.pdf + scattered.pdf), 1.0, light.is_delta);
    var radiance = light.radiance * visibility * scattered.value * (weight / light.pdf);
    if HAS_TRANSMISSION {
        radiance *= transmittance(medium_towards(s, light.direction, medium), light.distance);
    }
    return radiance;
}

// Light from the lights with hard shadows that a first surface scatters to the eye, over `links` mirrors and glass
// surfaces. A point on each light is sampled; since these lights are points or nearly so, the light has no noise but in
// narrow penumbrae.
fn hard_light(f: FirstHit, direction: vec3<f32>, links: u32, rng_in_pixel: Rng, rays: ptr<function, u32>) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    if (f.hit.prim & SPHERE) != 0u || links >= frame.sampling.reflections {
        return sum;
    }
    let s = f.surface;
    let medium = f.medium;
    var rng = rng_in_pixel;
    let u = random_at(&rng, links + 1u, LIGHT_POINT);
    let suns = select(0u, frame.lights.directional_count, frame.lights.has_hard_suns != 0u);
    for (var i = 0u; i < frame.lights.hard_count + suns; i += 1u) {
        var light: LightSample;
        if i < frame.lights.hard_count {
            light = sample_local_light(s.position, frame.lights.first_hard + i, 1.0, u);
        } else {
            light = sample_sun(frame.lights.local_count + i - frame.lights.hard_count, 1.0, u);
        }
        let scattered = evaluate(s, -direction, light.direction);
        if max3(scattered.value) * max3(light.radiance) > 0.0 {
            sum += unoccluded(s, medium, light, scattered, alpha_key(rng), rays);
        }
    }
    return sum * f.transmittance;
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

// Traces a path from the first surface of a pixel. The ray along `direction_in` arrived there through `medium_in`, over
// `links` mirrors and glass surfaces, which count as reflections.
fn trace_path(first: Surface, direction_in: vec3<f32>, medium_in: Medium, sampling: Sampling, links: u32, rng: ptr<function, Rng>) -> PathSample {
    var result = PathSample(vec3<f32>(0.0), vec3<f32>(0.0), 0u);
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
                regularize(&s, is_wide, sampling.spp);
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
    result.rays = rays;
    return result;
}
