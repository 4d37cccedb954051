// The first surface of a pixel: what a ray from the eye hits or what mirrors and clear glass on its way show instead,
// with what polish reflects; and where the pixel's path starts.

//!include frame rng math light_groups trace hits surface path mirrored mirror

struct FirstSurface {
    first: FirstHit,
    // Direction of the ray that hits it.
    direction: vec3<f32>,
    links: Links,
    polish: Polish,
    // Number of rays that were traced to find it.
    rays: u32,
}

// Hit of a ray from the eye.
fn primary_hit(view: u32, direction: vec3<f32>, rng: Rng) -> Hit {
    return trace_closest(frame.camera.views[view].origin, direction, alpha_key(rng));
}

// The surface at the primary hit of a pixel, or the one that it shows in mirrors and behind clear glass, whether the
// denoiser follows these or not. `traced` is the number of rays traced before.
fn shown_surface(view: u32, hit: Hit, direction_in: vec3<f32>, rng: Rng, traced: u32) -> FirstSurface {
    var first = first_hit(hit, frame.camera.views[view].origin, direction_in);
    var direction = direction_in;
    var rays = traced;
    let links = follow_mirrors(&first, &direction, rng, &rays);
    return FirstSurface(first, direction, links, Polish(), rays);
}

// The same, but mirrors and glass count as surfaces if the denoiser does not follow them.
fn surface_in_mirrors(view: u32, hit: Hit, direction: vec3<f32>, rng: Rng, traced: u32) -> FirstSurface {
    if HAS_MIRRORS {
        return shown_surface(view, hit, direction, rng, traced);
    }
    let first = first_hit(hit, frame.camera.views[view].origin, direction);
    return FirstSurface(first, direction, Links(), Polish(), traced);
}

// Traces what a polished first surface reflects.
fn add_polish(s: ptr<function, FirstSurface>, rng: Rng) {
    if HAS_POLISH {
        var first = (*s).first;
        var rays = (*s).rays;
        (*s).polish = follow_polish(&first, (*s).direction, (*s).links, rng, &rays);
        (*s).first = first;
        (*s).rays = rays;
    }
}

// The first surface of a pixel, with what it reflects if it is polished.
fn first_surface(view: u32, hit: Hit, direction: vec3<f32>, rng: Rng, traced: u32) -> FirstSurface {
    var s = surface_in_mirrors(view, hit, direction, rng, traced);
    add_polish(&s, rng);
    return s;
}

// Adds light from lights with hard shadows that reaches the eye from a first surface and from what it reflects.
fn add_hard_light(s: ptr<function, FirstSurface>, rng: Rng) {
    if HAS_HARD_LIGHTS {
        let polish = (*s).polish;
        var rays = (*s).rays;
        var sum = hard_light((*s).first, (*s).direction, (*s).links.count, rng, &rays);
        if HAS_POLISH && max3(polish.albedo) > 0.0 {
            sum += polish.weight * hard_light(polish.hit, polish.direction, (*s).links.count + 1u, rng, &rays);
        }
        (*s).first.emission += sum;
        (*s).rays = rays;
    }
}

// Whether the other eye sees a different radiance, on the first surface or reflected by it or by glass on the way to it.
fn is_view_dependent_over(s: FirstSurface) -> bool {
    let least = VIEW_DEPENDENT_FRACTION * luminance(s.first.albedo);
    let reflected = HAS_MIRRORS && HAS_TRANSMISSION && luminance(s.links.albedo) > least;
    return reflected || (HAS_POLISH && luminance(s.polish.albedo) > least) || is_view_dependent(s.first.surface);
}

// Minimum fraction of a polished surface's paths that start at what it reflects.
const LEAST_REFLECTED: f32 = 0.25;

// Minimum fraction of the paths through glass that start at the surface behind it. Dark glass shows little of its light,
// but the filter shares it with pixels beside the glass, which show the same surface brightly.
const LEAST_FOLLOWED: f32 = 0.25;

// Start of a pixel's path: its first surface, what this reflects, or what a reflection in glass on the way hits.
struct PathStart {
    hit: FirstHit,
    direction: vec3<f32>,
    links: u32,
    // Factor of the path's light.
    weight: vec3<f32>,
    // Light that the reflection finds at once, weighted.
    found: vec3<f32>,
    is_reflection: bool,
}

// Chooses between the first surface, what it reflects, and a reflection in glass, by their parts of the albedo, and
// traces the last.
fn start_of_path(s: FirstSurface, rng: ptr<function, Rng>, rays: ptr<function, u32>) -> PathStart {
    let first = s.first;
    let links = s.links;
    let polish = s.polish;
    if !((HAS_MIRRORS && HAS_TRANSMISSION) || HAS_POLISH) {
        return PathStart(first, s.direction, links.count, first.transmittance, vec3<f32>(0.0), false);
    }
    var rest = luminance(first.albedo);
    var pick = random_at(rng, 1u, LOBE_CHOICE).y;
    // 1 over the probability of not choosing what was offered so far.
    var unchosen = 1.0;
    if HAS_POLISH {
        let part = luminance(polish.albedo);
        let least = select(LEAST_REFLECTED, 0.0, part <= 0.0);
        let most = select(1.0 - LEAST_REFLECTED, 1.0, part >= rest);
        let odds = clamp(part / max(rest, 1e-20), least, most);
        if pick < odds {
            let weight = polish.hit.transmittance * polish.weight / odds;
            return PathStart(polish.hit, polish.direction, links.count + 1u, weight, vec3<f32>(0.0), true);
        }
        unchosen = 1.0 / max(1.0 - odds, 1e-7);
        pick = (pick - odds) * unchosen;
        rest -= part;
    }
    let reflected = luminance(links.albedo);
    let most = select(1.0 - LEAST_FOLLOWED, 1.0, reflected >= rest);
    let odds = select(0.0, min(reflected / max(rest, 1e-20), most), reflected > 0.0);
    if pick >= odds {
        let weight = first.transmittance * (unchosen / max(1.0 - odds, 1e-7));
        return PathStart(first, s.direction, links.count, weight, vec3<f32>(0.0), false);
    }
    var hit = first_hit_in(links.medium, trace_closest(links.origin, links.direction, alpha_key(*rng)), links.origin, links.direction);
    *rays += 1u;
    if HAS_HARD_LIGHTS {
        hit.emission += hard_light(hit, links.direction, links.depth, *rng, rays);
    }
    let weight = links.weight * (unchosen / odds);
    return PathStart(hit, links.direction, links.depth, hit.transmittance * weight, hit.emission * weight, true);
}
