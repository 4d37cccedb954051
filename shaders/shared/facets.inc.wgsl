// Microfacets: GGX distributions, which may be wider along the tangent than across, and Fresnel terms.

//!include frame math reflectance surface

// Tangent, bitangent and normal.
fn brushed_frame(s: Surface) -> mat3x3<f32> {
    return mat3x3<f32>(s.tangent, cross(s.normal, s.tangent), s.normal);
}

// Samples a microfacet normal that is visible from `v`. The third axis of `frame_n` is the surface's normal, and
// `alpha` the width along the first two (Dupuy & Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023).
fn sample_visible_normal(frame_n: mat3x3<f32>, v: vec3<f32>, alpha: vec2<f32>, u: vec2<f32>) -> vec3<f32> {
    let local = v * frame_n;
    let stretched = normalize(vec3<f32>(local.xy * alpha, local.z));
    let phi = 2.0 * PI * u.x;
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let sin_theta = sqrt(max(1.0 - z * z, 0.0));
    let h = vec3<f32>(sin_theta * cos(phi), sin_theta * sin(phi), z) + stretched;
    return normalize(frame_n * vec3<f32>(h.xy * alpha, max(h.z, 1e-7)));
}

// Density of microfacet normals. The sine comes from the cross product, since 1 - cos² cancels for small alpha.
fn ggx(n: vec3<f32>, h: vec3<f32>, a2: f32) -> f32 {
    let across = cross(n, h);
    let along = dot(n, h);
    let d = along * along * a2 + dot(across, across);
    return select(0.0, a2 / (PI * d * d), along > 0.0 && d > 0.0);
}

// Fraction of facets visible from both `v` and `l`, divided by 4 nv nl.
fn ggx_visibility(nv: f32, nl: f32, a2: f32) -> f32 {
    return 0.5 / max(nl * sqrt(a2 + nv * nv * (1.0 - a2)) + nv * sqrt(a2 + nl * nl * (1.0 - a2)), 1e-20);
}

// Fraction of facets visible from `v`, divided by 4 nv. Multiplied by the density of a facet's normal, it is the
// density of the direction that the facet reflects to.
fn ggx_reflection_pdf(nv: f32, a2: f32) -> f32 {
    return 0.5 / max(nv + sqrt(a2 + nv * nv * (1.0 - a2)), 1e-20);
}

// Density of the microfacet normals of reflection and transmission.
fn facet_density(s: Surface, h: vec3<f32>) -> f32 {
    if HAS_ANISOTROPY {
        if is_brushed(s) {
            let local = h * brushed_frame(s);
            let q = local / vec3<f32>(s.alpha_along, s.alpha, 1.0);
            let d = dot(q, q);
            return select(0.0, 1.0 / (PI * s.alpha_along * s.alpha * d * d), local.z > 0.0);
        }
    }
    return ggx(s.normal, h, s.alpha * s.alpha);
}

// Root in Smith's masking of facets whose width depends on the direction.
fn brushed_root(s: Surface, w: vec3<f32>) -> f32 {
    return length(w * brushed_frame(s) * vec3<f32>(s.alpha_along, s.alpha, 1.0));
}

// `ggx_visibility` for reflection and transmission. `nv` and `nl` are the absolute cosines of `v` and `l`.
fn facet_visibility(s: Surface, v: vec3<f32>, l: vec3<f32>, nv: f32, nl: f32) -> f32 {
    if HAS_ANISOTROPY {
        if is_brushed(s) {
            return 0.5 / max(nl * brushed_root(s, v) + nv * brushed_root(s, l), 1e-20);
        }
    }
    return ggx_visibility(nv, nl, s.alpha * s.alpha);
}

// `ggx_reflection_pdf` for reflection and transmission.
fn facet_reflection_pdf(s: Surface, v: vec3<f32>, nv: f32) -> f32 {
    if HAS_ANISOTROPY {
        if is_brushed(s) {
            return 0.5 / max(nv + brushed_root(s, v), 1e-20);
        }
    }
    return ggx_reflection_pdf(nv, s.alpha * s.alpha);
}

fn fresnel(f0: vec3<f32>, f90: vec3<f32>, cosine: f32) -> vec3<f32> {
    return select(f0 + (f90 - f0) * schlick_weight(cosine), f90, cosine < 0.0);
}

// Cosine for Schlick's term: the one on the side with the lower index of refraction. Below 0: total internal
// reflection.
fn fresnel_cosine(cosine: f32, eta: f32) -> f32 {
    if !HAS_TRANSMISSION {
        return cosine;
    }
    let cos2 = 1.0 - (1.0 - cosine * cosine) / (eta * eta);
    return select(cosine, select(-1.0, sqrt(max(cos2, 0.0)), cos2 > 0.0), eta < 1.0);
}

// Fraction of light that the dielectric layer reflects, so that the lobes beneath it lose it.
fn layer_fresnel(s: Surface, cosine: f32) -> f32 {
    return select(mix(s.layer_f0, s.layer_f90, schlick_weight(cosine)), s.layer_f90, cosine < 0.0);
}

// True if red, green and blue light is refracted differently.
fn is_dispersive(s: Surface) -> bool {
    return s.etas.x != s.etas.z;
}

// Reflectance of a facet that is seen at the cosine `vh`. Only the clear fraction reflects all light beyond the critical
// angle. Over the base, the layer reflects from inside as from outside: the base scatters at all angles, so total
// reflection beside it would make light.
fn facet_reflectance(s: Surface, vh: f32) -> vec3<f32> {
    let covered = fresnel(s.f0, s.f90, vh);
    if !HAS_TRANSMISSION {
        return covered;
    }
    var clear = fresnel(s.f0, s.f90, fresnel_cosine(vh, s.eta));
    if HAS_DISPERSION {
        if is_dispersive(s) {
            clear.r = fresnel(s.f0, s.f90, fresnel_cosine(vh, s.etas.r)).r;
            clear.b = fresnel(s.f0, s.f90, fresnel_cosine(vh, s.etas.b)).b;
        }
    }
    return covered * (1.0 - s.clear) + clear * s.clear;
}

// Fraction of light that a facet, seen at the cosine `vh`, leaves to transmission.
fn facet_passage(s: Surface, vh: f32) -> vec3<f32> {
    if HAS_DISPERSION {
        if is_dispersive(s) {
            let red = layer_fresnel(s, fresnel_cosine(vh, s.etas.r));
            let blue = layer_fresnel(s, fresnel_cosine(vh, s.etas.b));
            return 1.0 - vec3<f32>(red, layer_fresnel(s, fresnel_cosine(vh, s.etas.g)), blue);
        }
    }
    return vec3<f32>(1.0 - layer_fresnel(s, fresnel_cosine(vh, s.eta)));
}

// Probability that a facet seen at the cosine `vh` reflects rather than transmits.
fn reflection_odds(s: Surface, vh: f32) -> f32 {
    if !HAS_TRANSMISSION {
        return 1.0;
    }
    let back = luminance(facet_reflectance(s, vh));
    var through = 0.0;
    if HAS_DISPERSION && is_dispersive(s) {
        through = luminance(s.transmitted * facet_passage(s, vh));
    } else {
        through = luminance(s.transmitted) * facet_passage(s, vh).x;
    }
    return select(1.0, back / (back + through), through > 0.0);
}
