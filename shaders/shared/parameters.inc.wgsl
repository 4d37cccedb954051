// A material's parameters at a hit.

//!include tables scene

// Factors times textures.
struct Parameters {
    base: vec3<f32>,
    emissive: vec3<f32>,
    roughness: f32,
    metallic: f32,
    specular: f32,
    specular_color: vec3<f32>,
    transmission: f32,
    coat: f32,
    coat_roughness: f32,
    sheen: vec3<f32>,
    sheen_roughness: f32,
    through: f32,
    through_color: vec3<f32>,
    iridescence: f32,
    // Thickness of the film between its minimum (0) and maximum (1).
    film_thickness: f32,
    // Texel of the anisotropy: direction, each component from 0 to 1, and strength.
    brushed: vec3<f32>,
    // Texels of the normal maps, each component from 0 to 1.
    normal: vec3<f32>,
    coat_normal: vec3<f32>,
}

// Loops over the material's textures instead of branching for each kind of texture: software drivers do not skip
// branches, and the look-up is compiled only once.
fn parameters_at(row: u32, bary: vec2<f32>, m: Material) -> Parameters {
    var p: Parameters;
    p.base = base_factor_at(row, bary, m).rgb;
    p.emissive = m.emissive;
    p.roughness = m.roughness;
    p.metallic = m.metallic;
    p.specular = m.specular;
    p.specular_color = m.specular_color;
    p.transmission = m.transmission;
    p.coat = m.clearcoat;
    p.coat_roughness = m.clearcoat_roughness;
    p.sheen = m.sheen_color;
    p.sheen_roughness = m.sheen_roughness;
    p.through = m.diffuse_transmission;
    p.through_color = m.diffuse_transmission_color;
    p.iridescence = m.iridescence;
    p.film_thickness = 1.0;
    p.brushed = vec3<f32>(1.0, 0.5, 1.0);
    if !HAS_TEXTURES {
        return p;
    }
    for (var i = m.first_texture; i < m.first_texture + m.texture_count; i += 1u) {
        let info = stored_texture(i);
        let value = sample_texture(info, interpolate_uv(row, bary, info));
        let role = (info.flags >> ROLE_SHIFT) & 31u;
        p.base *= select(vec3<f32>(1.0), value.rgb, role == ROLE_BASE_COLOR);
        p.emissive *= select(vec3<f32>(1.0), value.rgb, role == ROLE_EMISSIVE);
        p.roughness *= select(1.0, value.g, role == ROLE_METALLIC_ROUGHNESS);
        p.metallic *= select(1.0, value.b, role == ROLE_METALLIC_ROUGHNESS);
        p.normal = select(p.normal, value.rgb, role == ROLE_NORMAL);
        p.specular *= select(1.0, value.a, role == ROLE_SPECULAR);
        p.specular_color *= select(vec3<f32>(1.0), value.rgb, role == ROLE_SPECULAR_COLOR);
        p.transmission *= select(1.0, value.r, role == ROLE_TRANSMISSION);
        p.coat *= select(1.0, value.r, role == ROLE_CLEARCOAT);
        p.coat_roughness *= select(1.0, value.g, role == ROLE_CLEARCOAT_ROUGHNESS);
        p.coat_normal = select(p.coat_normal, value.rgb, role == ROLE_CLEARCOAT_NORMAL);
        p.sheen *= select(vec3<f32>(1.0), value.rgb, role == ROLE_SHEEN_COLOR);
        p.sheen_roughness *= select(1.0, value.a, role == ROLE_SHEEN_ROUGHNESS);
        p.through *= select(1.0, value.a, role == ROLE_DIFFUSE_TRANSMISSION);
        p.through_color *= select(vec3<f32>(1.0), value.rgb, role == ROLE_DIFFUSE_TRANSMISSION_COLOR);
        p.iridescence *= select(1.0, value.r, role == ROLE_IRIDESCENCE);
        p.film_thickness *= select(1.0, value.g, role == ROLE_FILM_THICKNESS);
        p.brushed = select(p.brushed, value.rgb, role == ROLE_ANISOTROPY);
    }
    return p;
}
