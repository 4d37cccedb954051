// Reflectances: Schlick's Fresnel term, directional albedos of lobes, and thin films.

//!include frame math tables

// Directional albedo of GGX reflection over cosine and perceptual roughness, as (scale of f0, scale of f90), and that of
// a white sheen: a grid of ALBEDO_GRID x ALBEDO_GRID nodes, followed by the means over directions per roughness. See
// `tables::albedo_table`.
fn albedo_node(at: u32) -> vec3<f32> {
    return bitcast<vec3<f32>>(table_row(frame.tables.albedo + at).xyz);
}

struct LayerAlbedo {
    towards: vec3<f32>,
    mean: vec3<f32>,
}

fn layer_albedo(cosine: f32, roughness: f32) -> LayerAlbedo {
    let last = f32(ALBEDO_GRID - 1u);
    let x = clamp(cosine, 0.0, 1.0) * last;
    let y = clamp(roughness, 0.0, 1.0) * last;
    let column = min(u32(x), ALBEDO_GRID - 2u);
    let row = min(u32(y), ALBEDO_GRID - 2u);
    let fx = x - f32(column);
    let fy = y - f32(row);
    let at = row * ALBEDO_GRID + column;
    let low = mix(albedo_node(at), albedo_node(at + 1u), fx);
    let high = mix(albedo_node(at + ALBEDO_GRID), albedo_node(at + ALBEDO_GRID + 1u), fx);
    let means = ALBEDO_GRID * ALBEDO_GRID + row;
    return LayerAlbedo(mix(low, high, fy), mix(albedo_node(means), albedo_node(means + 1u), fy));
}

// Directional albedo of a white sheen as published. It exceeds 1 near grazing if the roughness is below 0.2.
fn sheen_albedo(cosine: f32, roughness: f32) -> f32 {
    return layer_albedo(sqrt(max(cosine, 0.0)), roughness).towards.z;
}

fn schlick_weight(cosine: f32) -> f32 {
    let m = clamp(1.0 - cosine, 0.0, 1.0);
    let m2 = m * m;
    return m2 * m2 * m;
}

// Reflectance of a surface at normal incidence under a thin film, such that Schlick's term has the reflectance of the
// film at this cosine (Belcour & Barla, "A Practical Extension to Microfacet Theory for the Modeling of Varying
// Iridescence", 2017, as simplified by KHR_materials_iridescence). `base_f0` is the reflectance without the film, and
// `thickness` is in nanometres. Evaluated at the viewer's cosine, not for each facet, as in Khronos' sample renderer.
fn film_f0(cosine: f32, film_ior: f32, thickness: f32, base_f0: vec3<f32>) -> vec3<f32> {
    // A vanishing film has no index of its own.
    let ior = mix(1.0, film_ior, smoothstep(0.0, 0.03, thickness));
    let cos2 = sqrt(max(1.0 - (1.0 - cosine * cosine) / (ior * ior), 0.0));
    let bend = (ior - 1.0) / (ior + 1.0);
    let r12 = mix(schlick_weight(cosine), 1.0, bend * bend);
    let root = sqrt(clamp(base_f0, vec3<f32>(0.0), vec3<f32>(0.9999)));
    let base_ior = (1.0 + root) / (1.0 - root);
    let base_bend = (base_ior - ior) / (base_ior + ior);
    let r23 = mix(vec3<f32>(schlick_weight(cos2)), vec3<f32>(1.0), base_bend * base_bend);
    // Phases: the film reflects from inside with a shift of pi, and the base if it is the less dense medium.
    let phase = PI + select(vec3<f32>(0.0), vec3<f32>(PI), base_ior < vec3<f32>(ior));
    let path = 2.0 * ior * thickness * cos2;
    let r123 = clamp(r12 * r23, vec3<f32>(1e-5), vec3<f32>(0.9999));
    let t121 = 1.0 - r12;
    let rs = t121 * t121 * r23 / (1.0 - r123);
    var sum = r12 + rs;
    var c = rs - t121;
    for (var order = 1; order <= 2; order += 1) {
        c *= sqrt(r123);
        sum += c * 2.0 * film_interference(f32(order) * path, f32(order) * phase);
    }
    let weight = min(schlick_weight(cosine), 0.9999);
    return clamp((max(sum, vec3<f32>(0.0)) - weight) / (1.0 - weight), vec3<f32>(0.0), vec3<f32>(1.0));
}

// Linear RGB of light whose waves interfere after a difference of paths, in nanometres, and a phase shift. The colour
// matching functions are fitted by Gaussians in the frequency (Belcour & Barla 2017).
fn film_interference(path: f32, shift: vec3<f32>) -> vec3<f32> {
    let phase = 2.0 * PI * path * 1e-9;
    // Heights times sqrt(2 pi variance), over the integral of the functions.
    let scale = vec3<f32>(0.84659, 1.00022, 1.00112);
    let at = vec3<f32>(1.6810e6, 1.7953e6, 2.2084e6) * phase + shift;
    var xyz = scale * cos(at) * exp(-phase * phase * vec3<f32>(4.3278e9, 9.3046e9, 6.6121e9));
    xyz.x += 0.15387 * cos(2.2399e6 * phase + shift.x) * exp(-4.5282e9 * phase * phase);
    return vec3<f32>(
        dot(xyz, vec3<f32>(3.2404542, -1.5371385, -0.4985314)),
        dot(xyz, vec3<f32>(-0.9692660, 1.8760108, 0.0415560)),
        dot(xyz, vec3<f32>(0.0556434, -0.2040259, 1.0572252)),
    );
}
