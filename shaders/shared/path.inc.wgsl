// The start of paths: the first hit of a ray from the eye, media, and light from sampled lights.

//!include frame rng math tables light_groups environment lights trace hits surface bsdf split

override HAS_CONSTANT_ENV: bool = true;

// Whether specular light of view-dependent pixels counts as emission, so that no filter blurs it.
override HAS_NARROW_LOBES: bool = true;

// Pairs of random dimensions that each vertex of a path uses. Their numbers are fixed, so that features that a scene
// lacks do not shift the others. The pair before them places the sample in its pixel.
const FIRST_DIMENSION: u32 = 1u;
const DIMENSIONS_PER_VERTEX: u32 = 5u;
const LIGHT_CHOICE: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LOBE_CHOICE: u32 = 2u;
const LOBE_DIRECTION: u32 = 3u;
const SURVIVAL: u32 = 4u;

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
