// Replaces perfect mirrors and clear glass by the surfaces that they show, so that filters follow those (primary surface
// replacement, as in NVIDIA's RTX Remix; Zimmer et al., "Path-space Motion Estimation and Decomposition for Robust
// Animation Filtering", 2015, filter light by the chain of mirrors it takes). All lobes of these surfaces are delta
// functions, so the followed ray is not random: mirrors reflect it and glass transmits it, except in total internal
// reflection. Paths choose between the followed surface and one of the reflections in glass on the way. Departure from
// Zimmer et al.: the image of a surface is assumed where paraxial rays meet, instead of searched for. In plane mirrors and
// behind thin panes, this is exact.

//!include frame rng math tables scene hits surface facets bsdf path motion last_surface mirror_motion

// Maximum number of mirrors and glass surfaces between the eye and the surface. A chain of more ends at one of them.
const MOST_LINKS: u32 = 8u;

// How two rays that are close to a path differ from it along the way: x belongs to a ray that leaves the eye parallel to
// the path, at a small distance, and y to one that leaves the eye's centre at a small angle. Both are means over the
// directions around the path, relative to that distance and angle (ray transfer matrices; Born & Wolf, "Principles of
// Optics", 7th edition, 4.3). For rays that are far from a surface's normal, they are an approximation.
struct Pencil {
    // Distance from the path.
    apart: vec2<f32>,
    // Angle with the path.
    angle: vec2<f32>,
}

// The pencil at the eye.
fn pencil_at_eye() -> Pencil {
    return Pencil(vec2<f32>(1.0, 0.0), vec2<f32>(0.0, 1.0));
}

fn along(p: Pencil, distance: f32) -> Pencil {
    return Pencil(p.apart + distance * p.angle, p.angle);
}

// Sum of the principal curvatures that a hit's triangle has by the normals of its corners, in 1/m: above 0 if the side
// that the ray met is convex.
fn curvature_of(f: FirstHit) -> f32 {
    let place = placed(f.hit.prim);
    let tri = triangle_at(place);
    let shade = shading_at(place);
    let edges = scaled_edges(tri);
    let e1 = edges.e1;
    let e2 = edges.e2;
    let turn1 = shade.n1 - shade.n0;
    let turn2 = shade.n2 - shade.n0;
    let n = cross(e1, e2);
    let trace = dot(turn1, e1) * dot(e2, e2) - (dot(turn1, e2) + dot(turn2, e1)) * dot(e1, e2) + dot(turn2, e2) * dot(e1, e1);
    let curvature = edges.scale * (trace / max(dot(n, n), 1e-37));
    return select(-curvature, curvature, f.surface.is_front);
}

// Least cosine for which a curved surface's power is computed: it is infinite for rays along the surface.
const LEAST_COSINE: f32 = 0.05;

// The pencil after a surface of that curvature reflects it.
fn reflected_pencil(p: Pencil, curvature: f32, cosine: f32) -> Pencil {
    let c = max(cosine, LEAST_COSINE);
    let power = 0.5 * curvature * (c + 1.0 / c);
    return Pencil(p.apart, p.angle + power * p.apart);
}

// The pencil after a surface of that curvature transmits it.
fn transmitted_pencil(p: Pencil, curvature: f32, s: Surface) -> Pencil {
    if s.is_thin || is_straight(s.eta) {
        return p;
    }
    let power = 0.5 * curvature * (1.0 / s.eta - 1.0);
    return Pencil(p.apart, p.angle / s.eta + power * p.apart);
}

// Distance of the farthest image of a surface, over the length of the path. Images behind the eye, too, count as so far.
const FARTHEST: f32 = 4.0;
// Distance beyond which images of the sky count as infinitely far, in m.
const FARTHEST_SKY: f32 = 1e6;

// Distance from the eye at which it sees the end of a path of that length: where rays that meet there seem to meet. 0 if
// the path ends in the sky and the image is infinitely far.
fn image_distance(p: Pencil, length: f32, is_sky: bool) -> f32 {
    let end = select(p.apart, p.angle, is_sky);
    let farthest = select(FARTHEST * length, FARTHEST_SKY, is_sky);
    let is_near = end.x * end.y > 0.0 && abs(end.y) < farthest * abs(end.x);
    return select(select(farthest, 0.0, is_sky), end.y / end.x, is_near);
}

// Fraction by which a plane mirror may change the angle between two rays.
const MOST_BENT: f32 = 1e-3;
// Smallest distance, in m, between two rays from the eye that are a unit of angle apart, at the end of a path. Where the
// rays meet again, the image is infinitely large.
const LEAST_APART: f32 = 0.05;

// Mirrors and glass between the eye and a first surface, and what the glass reflects.
struct Links {
    count: u32,
    // Distances of the images of the path's end and of the surface whose light is filtered (see `image_distance`). They
    // differ if the path ends in a light: the light that glass reflects is the first surface's.
    distance: f32,
    surface_distance: f32,
    // The pencil at the surface.
    pencil: Pencil,
    // Whether one of them has moved since the previous frame.
    has_moved: bool,
    // Fraction of uniform light that the glass reflects to the eye.
    albedo: vec3<f32>,
    // One of its reflections, chosen at random: the ray, the medium around it, the number of reflections before it and
    // including it, and the factor by which its light counts for all of them.
    origin: vec3<f32>,
    direction: vec3<f32>,
    medium: Medium,
    depth: u32,
    weight: vec3<f32>,
}

// What a polished surface reflects. Beside the delta lobes that reflect it, such a surface has others.
struct Polish {
    hit: FirstHit,
    // Direction of the reflected ray.
    direction: vec3<f32>,
    // Distance that a unit of angle at the eye covers at the reflected surface.
    spread: f32,
    // Fraction of the reflected light that reaches the eye.
    weight: vec3<f32>,
    // Albedo of the reflected surface times `weight`; 0 if nothing is reflected.
    albedo: vec3<f32>,
}

fn flags_of(f: FirstHit) -> u32 {
    return select(0u, stored_material(f.surface.material).flags, (f.hit.prim & SPHERE) == 0u);
}

// Whether a first surface is a perfect mirror or clear glass.
fn is_link(f: FirstHit) -> bool {
    return (flags_of(f) & (MIRROR | CLEAR_GLASS)) != 0u;
}

// Direction in which a smooth surface transmits a ray.
fn transmitted_direction(s: Surface, direction: vec3<f32>, cosine: f32) -> vec3<f32> {
    if s.is_thin || is_straight(s.eta) {
        return direction;
    }
    let cos2 = 1.0 - (1.0 - cosine * cosine) / (s.eta * s.eta);
    return normalize((cosine * s.normal + direction) / s.eta - sqrt(max(cos2, 0.0)) * s.normal);
}

// Moves a first hit along a chain of mirrors and glass to the first surface that is neither, to a light or to the sky.
// `direction` becomes the direction of the last ray, and `hit.t` the length of the whole path. The albedo includes what
// glass reflects. If the ray meets no surface behind glass, the hit is the first one again, with the light behind it
// as emission and the reflections as albedo. Uses the random dimensions of `trace_path`, where each link is a vertex.
fn follow_mirrors(f: ptr<function, FirstHit>, direction: ptr<function, vec3<f32>>, rng_in_pixel: Rng, rays: ptr<function, u32>) -> Links {
    var rng = rng_in_pixel;
    let most = min(MOST_LINKS, frame.sampling.reflections);
    var links = Links();
    if HAS_MOTION {
        mirror_motion = no_mirror_motion();
    }
    links.pencil = along(pencil_at_eye(), (*f).hit.t);
    let before = (*f).hit;
    let position = (*f).surface.position;
    let normal = (*f).surface.normal;
    let material = (*f).surface.material;
    var pick = 0.0;
    var sum = 0.0;
    if HAS_TRANSMISSION {
        pick = random_at(&rng, 1u, LOBE_CHOICE).x;
    }
    while links.count < most && is_link(*f) {
        let s = (*f).surface;
        let cosine = -dot(*direction, s.normal);
        let in_fresnel = fresnel_cosine(cosine, s.eta);
        let reflected = normalize(*direction + 2.0 * cosine * s.normal);
        // Interpolated normals may send rays to the wrong side of the surface, where their light ends.
        let is_reflected = dot(reflected, s.geometric_normal) > 0.0;
        var reflectance = (*f).transmittance * facet_reflectance(s, cosine);
        var onward = reflected;
        let curvature = curvature_of(*f);
        var pencil = reflected_pencil(links.pencil, curvature, cosine);
        var passed = reflectance;
        var is_sent = is_reflected;
        if HAS_TRANSMISSION && (flags_of(*f) & CLEAR_GLASS) != 0u && in_fresnel >= 0.0 {
            onward = transmitted_direction(s, *direction, cosine);
            pencil = transmitted_pencil(links.pencil, curvature, s);
            let eta2 = select(s.eta * s.eta, 1.0, s.is_thin || is_straight(s.eta));
            passed = (*f).transmittance * s.transmitted * ((1.0 - layer_fresnel(s, in_fresnel)) / eta2);
            is_sent = max(dot(onward, s.normal), dot(onward, s.geometric_normal)) < 0.0;
            let odds = select(0.0, luminance(reflectance), is_reflected && is_sent);
            if odds > 0.0 {
                sum += odds;
                links.albedo += reflectance;
                let threshold = odds / sum;
                let is_chosen = pick < threshold;
                pick = select((pick - threshold) / max(1.0 - threshold, 1e-7), pick / threshold, is_chosen);
                if is_chosen {
                    links.origin = leave(s, reflected);
                    links.direction = reflected;
                    links.medium = (*f).medium;
                    links.depth = links.count + 1u;
                    links.weight = reflectance / odds;
                }
            }
        }
        if !is_sent {
            break;
        }
        if HAS_MOTION {
            let last = last_surface((*f).hit.prim, (*f).hit.bary, s.position, s.normal);
            let is_flat = abs(pencil.angle.y - links.pencil.angle.y) < MOST_BENT;
            links.has_moved = links.has_moved || last.has_moved;
            mirror_motion = with_link(mirror_motion, *f, last, *direction, onward, links.count == 0u, is_flat);
        }
        rng.dimension = FIRST_DIMENSION + links.count * DIMENSIONS_PER_VERTEX + SURVIVAL;
        let origin = leave(s, onward);
        let medium = medium_towards(s, onward, (*f).medium);
        var next = first_hit_in(medium, trace_closest(origin, onward, alpha_key(rng)), origin, onward);
        next.emission = (*f).emission + next.emission * passed;
        next.albedo *= passed;
        next.matte *= passed;
        next.transmittance *= passed;
        links.pencil = along(pencil, next.hit.t);
        next.hit.t += (*f).hit.t;
        *f = next;
        *direction = onward;
        *rays += 1u;
        links.count += 1u;
    }
    links.distance = image_distance(links.pencil, (*f).hit.t, (*f).hit.prim == NO_PRIM);
    links.surface_distance = links.distance;
    if HAS_MOTION {
        let apart = links.pencil.apart.y;
        mirror_motion.magnification = links.distance / select(min(apart, -LEAST_APART), max(apart, LEAST_APART), apart > 0.0);
    }
    if HAS_TRANSMISSION && sum > 0.0 {
        if ((*f).hit.prim & SPHERE) != 0u {
            (*f).hit = before;
            links.surface_distance = before.t;
            if HAS_MOTION {
                mirror_motion = no_mirror_motion();
            }
            // All of its light is in the reflections, so nothing else of the surface is needed.
            (*f).surface.position = position;
            (*f).surface.normal = normal;
            (*f).surface.material = material;
        }
        links.weight *= sum;
        (*f).albedo += links.albedo;
    }
    return links;
}

// Traces what a polished first surface reflects by its delta lobes: smooth paint, a smooth coat. The albedo takes over
// that of the reflected surface, so that light is stored without the textures of both surfaces, and the emission what
// the reflected surface emits. The delta lobes are removed from the first surface. Uses the random dimensions of
// `trace_path`, where the surface is a vertex.
fn follow_polish(f: ptr<function, FirstHit>, direction: vec3<f32>, links: Links, rng_in_pixel: Rng, rays: ptr<function, u32>) -> Polish {
    var polish = Polish();
    if (flags_of(*f) & POLISHED) == 0u || links.count >= frame.sampling.reflections {
        return polish;
    }
    let s = (*f).surface;
    let cosine = -dot(direction, s.normal);
    let is_base_smooth = s.alpha < SMOOTH;
    let has_coat = HAS_CLEARCOAT && s.coat > 0.0;
    let is_coat_smooth = has_coat && s.coat_alpha < SMOOTH;
    let of_base = select(vec3<f32>(0.0), fresnel(s.f0, s.f90, cosine) * (1.0 - s.coat), is_base_smooth);
    let weight = (*f).transmittance * (of_base + select(0.0, s.coat, is_coat_smooth));
    let reflected = normalize(direction + 2.0 * cosine * s.normal);
    if max3(weight) <= 0.0 || dot(reflected, s.geometric_normal) <= 0.0 {
        return polish;
    }
    var rng = rng_in_pixel;
    rng.dimension = FIRST_DIMENSION + links.count * DIMENSIONS_PER_VERTEX + SURVIVAL;
    let origin = leave(s, reflected);
    polish.hit = first_hit_in((*f).medium, trace_closest(origin, reflected, alpha_key(rng)), origin, reflected);
    polish.direction = reflected;
    var pencil = links.pencil;
    if links.count == 0u {
        pencil = along(pencil_at_eye(), (*f).hit.t);
    }
    polish.spread = along(reflected_pencil(pencil, curvature_of(*f), cosine), polish.hit.hit.t).apart.y;
    polish.weight = weight;
    polish.albedo = polish.hit.albedo * weight;
    *rays += 1u;
    let has_rough_lobe = !is_base_smooth || (has_coat && !is_coat_smooth);
    let rough = max((*f).albedo - links.albedo - (*f).matte - weight, vec3<f32>(0.0));
    (*f).albedo = (*f).matte + select(vec3<f32>(0.0), rough, has_rough_lobe) + polish.albedo + links.albedo;
    (*f).emission += polish.hit.emission * weight;
    let odds = select(s.odds, vec3<f32>(0.0), vec3<bool>(false, is_base_smooth, is_coat_smooth));
    let sum = odds.x + odds.y + odds.z;
    (*f).surface.odds = select(vec3<f32>(0.0), odds / sum, sum > 0.0);
    return polish;
}
