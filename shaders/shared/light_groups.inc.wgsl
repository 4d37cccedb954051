// Groups of lights and their probabilities, and samples of lights (see `lights`).

//!include frame

// Whether `hard_light` computes the light of lights with hard shadows at the first vertices of paths.
override HAS_HARD_LIGHTS: bool = false;

struct LightSample {
    direction: vec3<f32>,
    // 3e38 if infinitely far.
    distance: f32,
    radiance: vec3<f32>,
    // Solid-angle density, or for delta lights the probability of the pick; 0 if nothing was sampled.
    pdf: f32,
    is_delta: bool,
    // Spherical light that the shadow ray ignores.
    sphere: u32,
    // Fraction of the distance that must be unoccluded: all but the error of the hit point on the light.
    reach: f32,
}

fn no_light() -> LightSample {
    return LightSample(vec3<f32>(0.0, 1.0, 0.0), 0.0, vec3<f32>(0.0), 0.0, false, NO_LIGHT, 1.0);
}

// Whether local lights are sampled.
fn samples_local(is_first: bool) -> bool {
    return frame.lights.local_count > select(0u, frame.lights.hard_count, HAS_HARD_LIGHTS && is_first);
}

// Whether directional lights are sampled.
fn samples_directional(is_first: bool) -> bool {
    let are_left_out = HAS_HARD_LIGHTS && is_first && frame.lights.has_hard_suns != 0u;
    return frame.lights.directional_count > 0u && !are_left_out;
}

// Number of groups that are sampled.
fn group_count(is_first: bool) -> u32 {
    var count = frame.lights.group_count;
    if HAS_HARD_LIGHTS && is_first {
        count -= select(0u, 1u, frame.lights.local_count > 0u && !samples_local(true));
        count -= select(0u, 1u, frame.lights.directional_count > 0u && !samples_directional(true));
    }
    return count;
}

// Probability of picking one of the groups that are sampled.
fn group_probability(is_first: bool) -> f32 {
    return 1.0 / f32(group_count(is_first));
}
