// Scattering at a surface: glTF's material model (specification 2.0, appendix B, and the KHR extensions).
//
// Lobes: Lambertian reflection and transmission; GGX reflection of dielectric and metal, which share microfacets; GGX
// transmission, through a thin sheet or into a volume (Walter et al. 2007), which may disperse colours; GGX reflection of
// a clear coat; sheen (Estevez & Kulla 2017). Masking and shadowing are height-correlated (Heitz 2014), Fresnel is
// Schlick's. `evaluate` returns value and density of all non-delta lobes, and `sample_bsdf` samples the same mixture.
//
// Departure: the appendix weights the lobes beneath the dielectric by 1 - F(V.H), which creates energy at grazing
// angles: 50 % more for a smooth white surface at a cosine of 0.1. The weight here never exceeds that of Kelemen &
// Szirmay-Kalos (2001), which conserves energy exactly.

//!include math reflectance surface facets

struct Scattering {
    // BSDF times cosine.
    value: vec3<f32>,
    // Solid-angle density of `sample_bsdf`; 0 if it never samples this direction.
    pdf: f32,
}

struct BsdfSample {
    direction: vec3<f32>,
    // BSDF times cosine over density.
    weight: vec3<f32>,
    // 0 if nothing was sampled.
    pdf: f32,
    // Delta lobe: light sampling cannot find its direction.
    is_delta: bool,
}

// Samples a direction with density cos / pi around `n` (Malley's method on the concentric disc of Shirley & Chiu 1997).
fn sample_cosine(n: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let o = 2.0 * u - 1.0;
    var r = o.x;
    var phi = 0.0;
    if abs(o.x) > abs(o.y) {
        phi = (PI / 4.0) * (o.y / o.x);
    } else if o.y != 0.0 {
        r = o.y;
        phi = (PI / 2.0) - (PI / 4.0) * (o.x / o.y);
    }
    let d = r * vec2<f32>(cos(phi), sin(phi));
    return normalize(frame_around(n) * vec3<f32>(d, sqrt(max(1.0 - r * r, 0.0))));
}

// Fraction of light that passes the dielectric layer on its way in and out.
fn layer_passage(s: Surface, vh: f32, nl: f32) -> f32 {
    let l = layer_albedo(nl, s.roughness).towards;
    let conserving = (1.0 - s.layer_albedo) * (1.0 - (s.layer_f0 * l.x + s.layer_f90 * l.y)) / max(1.0 - s.layer_mean, 1e-3);
    return max(min(1.0 - layer_fresnel(s, vh), conserving), 0.0);
}

// Fraction of light that passes the dielectric layers on both sides of a sheet, on its way from one side to the other.
fn sheet_passage(s: Surface, nl: f32) -> f32 {
    let l = layer_albedo(nl, s.roughness).towards;
    let out = 1.0 - (s.layer_f0 * l.x + s.layer_f90 * l.y);
    return max((1.0 - s.layer_albedo) * out / max(1.0 - s.layer_mean, 1e-3), 0.0);
}

// Fraction of light that passes the sheen on its way in and out.
fn sheen_passage(s: Surface, nl: f32) -> f32 {
    if !HAS_SHEEN {
        return 1.0;
    }
    let away = sheen_albedo(abs(nl), s.sheen_roughness);
    return 1.0 - max3(s.sheen) * min(max(s.sheen_albedo, away), 1.0);
}

// Value of a white sheen times the light's cosine: the "Charlie" distribution, with fitted shadowing (Estevez & Kulla,
// "Production Friendly Microfacet Sheen BRDF", 2017). Scaled down where it would reflect more light than arrives.
fn sheen_scattering(s: Surface, nv: f32, nl: f32, h: vec3<f32>) -> f32 {
    let alpha = s.sheen_roughness * s.sheen_roughness;
    let across = cross(s.normal, h);
    let sin2 = clamp(dot(across, across), 1e-20, 1.0);
    let d = (2.0 + 1.0 / alpha) * pow(sin2, 0.5 / alpha) / (2.0 * PI);
    let most = max(s.sheen_albedo, 1.0) * max(sheen_albedo(nl, s.sheen_roughness), 1.0);
    return d / ((1.0 + sheen_shadowing(nv, alpha) + sheen_shadowing(nl, alpha)) * 4.0 * nv * most);
}

// Λ of the sheen's shadowing.
fn sheen_shadowing(cosine: f32, alpha: f32) -> f32 {
    let x = min(cosine, 1.0 - cosine);
    let l = sheen_fit(max(x, 1e-20), alpha);
    return exp(select(2.0 * sheen_fit(0.5, alpha) - l, l, cosine < 0.5));
}

fn sheen_fit(x: f32, alpha: f32) -> f32 {
    let t = (1.0 - alpha) * (1.0 - alpha);
    let a = mix(21.5473, 25.3245, t);
    let b = mix(3.82987, 3.32435, t);
    let c = mix(0.19823, 0.16801, t);
    let d = mix(-1.97760, -1.27393, t);
    let e = mix(-4.32054, -4.85967, t);
    return a / (1.0 + b * pow(x, c)) + d * x + e;
}

fn evaluate(s: Surface, v: vec3<f32>, l: vec3<f32>) -> Scattering {
    let nl = dot(s.normal, l);
    let is_above = dot(s.geometric_normal, l) > 0.0;
    if all_are_lambertian() {
        let cosine = select(0.0, max(nl, 0.0) / PI, is_above);
        return Scattering(s.diffuse * cosine, cosine);
    }
    let nv = max(dot(s.normal, v), 1e-6);
    var out = Scattering(vec3<f32>(0.0), 0.0);
    if is_above && nl > 0.0 {
        let h = normalize(v + l);
        let vh = clamp(dot(v, h), 0.0, 1.0);
        out.value = s.diffuse * (layer_passage(s, vh, nl) * nl / PI);
        out.pdf = s.odds.x * nl / PI;
        if HAS_DIFFUSE_TRANSMISSION {
            out.pdf *= 1.0 - s.through_odds;
        }
        if s.alpha >= SMOOTH {
            let d = facet_density(s, h);
            out.value += facet_reflectance(s, vh) * (d * facet_visibility(s, v, l, nv, nl) * nl);
            out.pdf += s.odds.y * reflection_odds(s, vh) * d * facet_reflection_pdf(s, v, nv);
        }
    }
    if HAS_TRANSMISSION {
        if !is_above && nl < 0.0 && s.alpha >= SMOOTH {
            let through = transmit(s, v, l, nv, -nl);
            out.value += s.transmitted * through.value;
            out.pdf += s.odds.y * through.pdf;
        }
    }
    if HAS_DIFFUSE_TRANSMISSION {
        if !is_above && nl < 0.0 {
            out.value += s.through * (sheet_passage(s, -nl) * -nl / PI);
            out.pdf += s.odds.x * s.through_odds * -nl / PI;
        }
    }
    if HAS_SHEEN {
        out.value *= sheen_passage(s, nl);
        if is_above && nl > 0.0 {
            out.value += s.sheen * sheen_scattering(s, nv, nl, normalize(v + l));
        }
    }
    if HAS_CLEARCOAT {
        out.value *= 1.0 - s.coat;
        let coat_nl = dot(s.coat_normal, l);
        if is_above && coat_nl > 0.0 && s.coat_alpha >= SMOOTH && s.coat > 0.0 {
            let coat_a2 = s.coat_alpha * s.coat_alpha;
            let coat_nv = max(dot(s.coat_normal, v), 1e-6);
            let d = ggx(s.coat_normal, normalize(v + l), coat_a2);
            out.value += s.coat * (d * ggx_visibility(coat_nv, coat_nl, coat_a2) * coat_nl);
            out.pdf += s.odds.z * d * ggx_reflection_pdf(coat_nv, coat_a2);
        }
    }
    return out;
}

// Transmission lobe for a colour of 1, and its density given that the facets' lobe is picked. `nv` and `nl` are
// absolute cosines.
fn transmit(s: Surface, v: vec3<f32>, l: vec3<f32>, nv: f32, nl: f32) -> Scattering {
    if s.is_thin {
        // Thin sheet: facets reflect, and the light leaves on the other side.
        let h = normalize(v + l + 2.0 * nl * s.normal);
        let d = facet_density(s, h);
        let vh = clamp(dot(v, h), 0.0, 1.0);
        let pdf = (1.0 - reflection_odds(s, vh)) * d * facet_reflection_pdf(s, v, nv);
        return Scattering(facet_passage(s, vh) * d * facet_visibility(s, v, l, nv, nl) * nl, pdf);
    }
    if is_straight(s.eta) {
        return Scattering(vec3<f32>(0.0), 0.0);
    }
    if HAS_DISPERSION {
        if is_dispersive(s) {
            // Each colour has a lobe of its own.
            var all = Scattering(vec3<f32>(0.0), 0.0);
            for (var c = 0; c < 3; c += 1) {
                let one = refract_at(s, v, l, nv, nl, s.etas[c]);
                all.value[c] = one.value[c];
                all.pdf += one.pdf * s.colors[c];
            }
            return all;
        }
    }
    return refract_at(s, v, l, nv, nl, s.eta);
}

// Refraction into the volume for a colour of 1, with this index of refraction.
fn refract_at(s: Surface, v: vec3<f32>, l: vec3<f32>, nv: f32, nl: f32, eta: f32) -> Scattering {
    let sum = v + eta * l;
    let h = select(sum, -sum, dot(sum, s.normal) < 0.0) * inverseSqrt(max(dot(sum, sum), 1e-30));
    let vh = dot(v, h);
    let lh = dot(l, h);
    if vh <= 0.0 || lh >= 0.0 {
        return Scattering(vec3<f32>(0.0), 0.0);
    }
    let d = facet_density(s, h);
    let bend = vh + eta * lh;
    // Factor that value and density have in common. It contains |l.h| / bend², which is Walter et al.'s Jacobian
    // without its factor eta². In the value, that factor cancels, since refraction divides radiance by eta².
    let shared_ = 4.0 * d * vh * -lh / max(bend * bend, 1e-20);
    return Scattering(
        facet_passage(s, vh) * shared_ * facet_visibility(s, v, l, nv, nl) * nl,
        (1.0 - reflection_odds(s, vh)) * shared_ * eta * eta * facet_reflection_pdf(s, v, nv),
    );
}

// True if `eta` is so close to 1 that transmitted light is not refracted. Transmission is then a delta lobe, however
// rough the surface.
fn is_straight(eta: f32) -> bool {
    return abs(eta - 1.0) < 1e-3;
}

// Fraction of light that passes straight through a thin, smooth surface, along `direction` from the viewer's side: the
// weight of its delta transmission. 0 for every other surface.
fn straight_transmittance(s: Surface, direction: vec3<f32>) -> vec3<f32> {
    if !HAS_TRANSMISSION || !s.is_thin || s.alpha >= SMOOTH {
        return vec3<f32>(0.0);
    }
    let cosine = abs(dot(s.normal, direction));
    return s.transmitted * ((1.0 - layer_fresnel(s, cosine)) * (1.0 - s.coat) * sheen_passage(s, cosine));
}

// Fraction of the value of `evaluate` that belongs to the wide lobes: Lambert and sheen.
fn matte_fraction(s: Surface, v: vec3<f32>, l: vec3<f32>, value: vec3<f32>) -> vec3<f32> {
    let nl = max(dot(s.normal, l), 0.0);
    let h = normalize(v + l);
    var matte = s.diffuse * (layer_passage(s, clamp(dot(v, h), 0.0, 1.0), nl) * nl / PI * (1.0 - s.coat));
    if HAS_SHEEN && nl > 0.0 {
        let sheen = s.sheen * sheen_scattering(s, max(dot(s.normal, v), 1e-6), nl, h);
        matte = matte * sheen_passage(s, nl) + sheen * (1.0 - s.coat);
    }
    let is_above = dot(s.geometric_normal, l) > 0.0;
    let fraction = select(vec3<f32>(0.0), min(matte / max(value, vec3<f32>(1e-20)), vec3<f32>(1.0)), is_above);
    if HAS_DIFFUSE_TRANSMISSION {
        let away = -dot(s.normal, l);
        let passage = sheet_passage(s, max(away, 0.0)) * sheen_passage(s, away) * (1.0 - s.coat);
        let through = s.through * (passage * away / PI);
        let below = min(through / max(value, vec3<f32>(1e-20)), vec3<f32>(1.0));
        return select(fraction, below, !is_above && away > 0.0);
    }
    return fraction;
}

fn sample_bsdf(s: Surface, v: vec3<f32>, pick: f32, u: vec2<f32>) -> BsdfSample {
    var out: BsdfSample;
    out.pdf = 0.0;
    if all_are_lambertian() {
        out.direction = sample_cosine(s.normal, u);
        out.pdf = select(0.0, max(dot(out.direction, s.normal), 0.0) / PI, dot(out.direction, s.geometric_normal) > 0.0);
        out.weight = s.diffuse;
        return out;
    }
    // Lobes in the order of `odds`. The last possible one absorbs rounding.
    var lobe = 0u;
    lobe = select(lobe, 1u, s.odds.y > 0.0 && pick >= s.odds.x);
    lobe = select(lobe, 2u, s.odds.z > 0.0 && pick >= s.odds.x + s.odds.y);
    if s.odds[lobe] <= 0.0 {
        return out;
    }
    if lobe == 0u {
        out.direction = sample_cosine(s.normal, u);
        if HAS_DIFFUSE_TRANSMISSION {
            // The rest of the random number chooses the side.
            if pick < s.odds.x * s.through_odds {
                out.direction -= 2.0 * dot(out.direction, s.normal) * s.normal;
            }
        }
    } else {
        // The rest of the random number chooses between reflection and transmission.
        let rest = select((pick - s.odds.x) / s.odds.y, 0.0, lobe == 2u);
        sample_facet(s, v, lobe == 2u, rest, u, &out);
        if out.is_delta || out.pdf < 0.0 {
            return out;
        }
    }
    let all = evaluate(s, v, out.direction);
    out.pdf = all.pdf;
    // Purely Lambertian surfaces have an exact weight.
    let only_diffuse = s.odds.x == 1.0 && max3(s.f0) == 0.0 && s.f90.x == 0.0 && !(HAS_SHEEN && max3(s.sheen) > 0.0)
        && !(HAS_DIFFUSE_TRANSMISSION && s.through_odds > 0.0);
    out.weight = select(all.value / max(all.pdf, 1e-30), s.diffuse, only_diffuse);
    return out;
}

// Samples a direction from the facets' lobe or the coat's. For delta lobes, the density is 1, or 0 if the facet sends
// no light in that direction. For other lobes it is below 0 in that case, and otherwise the caller computes it.
fn sample_facet(s: Surface, v: vec3<f32>, coat: bool, pick: f32, u: vec2<f32>, out: ptr<function, BsdfSample>) {
    let is_coat = HAS_CLEARCOAT && coat;
    let n = select(s.normal, s.coat_normal, is_coat);
    let alpha = select(s.alpha, s.coat_alpha, is_coat);
    let is_smooth = alpha < SMOOTH;
    var axes = frame_around(n);
    var widths = vec2<f32>(max(alpha, SMOOTH));
    if HAS_ANISOTROPY {
        if !is_coat && is_brushed(s) {
            axes = brushed_frame(s);
            widths = vec2<f32>(s.alpha_along, s.alpha);
        }
    }
    let h = select(sample_visible_normal(axes, v, widths, u), n, is_smooth);
    let cosine = abs(dot(v, h));
    let reflects = select(reflection_odds(s, cosine), 1.0, is_coat);
    let crosses = HAS_TRANSMISSION && pick >= reflects && reflects < 1.0;
    (*out).is_delta = is_smooth || (crosses && !s.is_thin && is_straight(s.eta));
    let vh = dot(v, h);
    var l = 2.0 * vh * h - v;
    (*out).pdf = 0.0;
    var weight = select(facet_reflectance(s, cosine) / reflects, vec3<f32>(s.coat), is_coat);
    if crosses {
        weight = s.transmitted * (facet_passage(s, cosine) / (1.0 - reflects));
        if s.is_thin {
            // The facet's reflection leaves on the other side. A smooth sheet transmits straight through.
            l -= 2.0 * dot(s.normal, l) * s.normal;
        } else if is_straight(s.eta) {
            l = -v;
        } else {
            var eta = s.eta;
            if HAS_DISPERSION {
                if is_dispersive(s) {
                    // The rest of the random number chooses the colour. A smooth surface sends the others elsewhere.
                    let rest = (pick - reflects) / (1.0 - reflects);
                    let color = select(0, 1, rest >= s.colors.r) + select(0, 1, rest >= s.colors.r + s.colors.g);
                    eta = s.etas[color];
                    let is_color = vec3<i32>(color) == vec3<i32>(0, 1, 2);
                    weight *= select(vec3<f32>(0.0), vec3<f32>(1.0 / max(s.colors[color], 1e-6)), is_color);
                }
            }
            let cos2 = 1.0 - (1.0 - vh * vh) / (eta * eta);
            l = (vh * h - v) / eta - sqrt(max(cos2, 0.0)) * h;
            weight /= eta * eta;
            (*out).pdf = select(0.0, -1.0, cos2 <= 0.0);
        }
    }
    (*out).direction = normalize(l);
    // A facet may send light to a side of the surface where its lobe is 0.
    let side = select(1.0, -1.0, crosses);
    let is_sent = side * dot((*out).direction, n) > 0.0 && side * dot((*out).direction, s.geometric_normal) > 0.0;
    (*out).pdf = select(-1.0, (*out).pdf, is_sent);
    if (*out).is_delta {
        let shown = select((1.0 - s.coat) * sheen_passage(s, dot((*out).direction, n)), 1.0, is_coat);
        (*out).weight = weight * (shown / select(s.odds.y, s.odds.z, is_coat));
        (*out).pdf = select(0.0, 1.0, (*out).pdf >= 0.0);
    }
}
