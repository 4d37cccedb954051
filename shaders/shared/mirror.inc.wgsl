// Replaces perfect mirrors by the surfaces that they show, so that filters follow those (primary surface replacement, as
// in NVIDIA's RTX Remix; Zimmer et al., "Path-space Motion Estimation and Decomposition for Robust Animation Filtering",
// 2015, filter light by the chain of mirrors it takes). A perfect mirror has a single lobe, a delta function, so the
// reflected ray is not random. Departure from Zimmer et al.: the image of a surface is assumed at the length of the path,
// which is exact in plane mirrors, instead of searched for.

// Maximum number of mirrors between the eye and the surface. A chain of more ends at a mirror.
const MOST_LINKS: u32 = 8u;

fn is_mirror(f: FirstHit) -> bool {
    return (f.hit.prim & SPHERE) == 0u && (stored_material(f.surface.material).flags & MIRROR) != 0u;
}

// Moves a first hit along mirror reflections to the first surface that is not a mirror, to a light or to the sky, and
// returns the number of mirrors on the way. `direction` becomes the direction of the last ray, and `hit.t` the length
// of the whole path. Uses the random dimensions of `trace_path`, where each mirror is a vertex.
fn follow_mirrors(f: ptr<function, FirstHit>, direction: ptr<function, vec3<f32>>, rng_in_pixel: Rng, rays: ptr<function, u32>) -> u32 {
    var rng = rng_in_pixel;
    let most = min(MOST_LINKS, frame.sampling.reflections);
    var links = 0u;
    while links < most && is_mirror(*f) {
        let s = (*f).surface;
        let cosine = -dot(*direction, s.normal);
        let reflected = normalize(*direction + 2.0 * cosine * s.normal);
        // Interpolated normals may reflect rays into the surface, where their light ends.
        if dot(reflected, s.geometric_normal) <= 0.0 {
            break;
        }
        rng.dimension = FIRST_DIMENSION + links * DIMENSIONS_PER_VERTEX + SURVIVAL;
        let origin = leave(s, reflected);
        var next = first_hit(trace_closest(origin, reflected, alpha_key(rng)), origin, reflected);
        let passed = (*f).transmittance * fresnel(s.f0, s.f90, cosine);
        next.emission = (*f).emission + next.emission * passed;
        next.albedo *= passed;
        next.matte *= passed;
        next.transmittance *= passed;
        next.hit.t += (*f).hit.t;
        *f = next;
        *direction = reflected;
        *rays += 1u;
        links += 1u;
    }
    return links;
}
