// Diffuse radiance of a surface's Lambertian lobe (matte) and specular radiance of its facets (gloss), which are
// filtered separately if the scene has gloss. Both are then packed into one pixel of half floats, scaled so that
// white is 1 at the exposure of the run (`storage_scale`). Otherwise `matte` holds all radiance, as floats.

override HAS_GLOSS: bool = true;

struct SplitLight {
    matte: vec3<f32>,
    gloss: vec3<f32>,
    // Variances of the luminance of matte and of gloss.
    a: vec2<f32>,
}

// Last word of a pixel that was sampled in this frame; 0 if it was not. As a float it is the pixel's weight in filters.
const SAMPLED: u32 = 0x3f800000u;
// Flag of a last word that holds the variances of the samples' luminance instead of SAMPLED.
const TELLS_VARIANCE: u32 = 0x80000000u;

// The largest half float.
const MOST_LIGHT: f32 = 65504.0;

// Whether light is too bright to store. It is then clamped to MOST_LIGHT times white.
fn is_clipped(matte: vec3<f32>, gloss: vec3<f32>) -> bool {
    return HAS_GLOSS && any(max(matte, gloss) * frame.display.storage_scale > vec3<f32>(MOST_LIGHT));
}

fn pack_pair(a: f32, b: f32) -> u32 {
    return pack2x16float(min(vec2<f32>(a, b), vec2<f32>(MOST_LIGHT)));
}

fn unpack_light(bits: vec4<u32>) -> SplitLight {
    if !HAS_GLOSS {
        let all = bitcast<vec4<f32>>(bits);
        return SplitLight(all.rgb, vec3<f32>(0.0), vec2<f32>(all.a));
    }
    let scale = 1.0 / frame.display.storage_scale;
    let y = unpack2x16float(bits.y);
    let matte = vec3<f32>(unpack2x16float(bits.x), y.x);
    let gloss = vec3<f32>(y.y, unpack2x16float(bits.z));
    return SplitLight(matte * scale, gloss * scale, unpack_deviations(bits.w));
}

fn pack_light(light: SplitLight) -> vec4<u32> {
    if !HAS_GLOSS {
        return bitcast<vec4<u32>>(vec4<f32>(light.matte, light.a.x));
    }
    let matte = light.matte * frame.display.storage_scale;
    let gloss = light.gloss * frame.display.storage_scale;
    return vec4<u32>(
        pack_pair(matte.r, matte.g),
        pack_pair(matte.b, gloss.r),
        pack_pair(gloss.g, gloss.b),
        pack_deviations(light.a),
    );
}

// Packs radiance that was sampled in this frame.
fn pack_sampled(matte: vec3<f32>, gloss: vec3<f32>) -> vec4<u32> {
    return vec4<u32>(pack_light(SplitLight(matte, gloss, vec2<f32>(0.0))).xyz, SAMPLED);
}

// Packs radiance with the variance of its samples.
fn pack_sampled_with(matte: vec3<f32>, gloss: vec3<f32>, variance: vec2<f32>) -> vec4<u32> {
    let bits = pack_light(SplitLight(matte, gloss, variance));
    return vec4<u32>(bits.xyz, bits.w | TELLS_VARIANCE);
}

// Unpacks radiance that was sampled in this frame, with the variance of its samples if stored.
fn unpack_sampled(bits: vec4<u32>) -> SplitLight {
    return unpack_light(vec4<u32>(bits.xyz, bits.w & ~TELLS_VARIANCE));
}

// Packs variances as standard deviations. Negative values (flags) stay.
fn pack_deviations(variances: vec2<f32>) -> u32 {
    let scaled = sqrt(max(variances, vec2<f32>(0.0))) * frame.display.storage_scale;
    let deviations = select(scaled, variances, variances < vec2<f32>(0.0));
    return pack_pair(deviations.x, deviations.y);
}

fn unpack_deviations(bits: u32) -> vec2<f32> {
    let deviations = unpack2x16float(bits);
    let scaled = deviations / frame.display.storage_scale;
    return select(scaled * scaled, deviations, deviations < vec2<f32>(0.0));
}

// Albedo for demodulation: the fraction of uniform light that the surface reflects, and its diffuse part.
struct Albedo {
    all: vec3<f32>,
    matte: vec3<f32>,
    roughness: f32,
}

fn unpack_albedo(bits: vec4<u32>) -> Albedo {
    if !HAS_GLOSS {
        let all = bitcast<vec4<f32>>(bits);
        return Albedo(all.rgb, all.rgb, all.a);
    }
    let y = unpack2x16float(bits.y);
    let gloss = vec3<f32>(unpack2x16float(bits.x), y.x);
    let matte = vec3<f32>(unpack2x16float(bits.z), unpack2x16float(bits.w).x);
    return Albedo(gloss + matte, matte, y.y);
}

fn pack_albedo(albedo: Albedo) -> vec4<u32> {
    if !HAS_GLOSS {
        return bitcast<vec4<u32>>(vec4<f32>(albedo.all, albedo.roughness));
    }
    // Store the specular part itself: as the difference of two rounded numbers it would be off by some percent.
    let gloss = max(albedo.all - albedo.matte, vec3<f32>(0.0));
    return vec4<u32>(
        pack_pair(gloss.r, gloss.g),
        pack_pair(gloss.b, albedo.roughness),
        pack_pair(albedo.matte.r, albedo.matte.g),
        pack_pair(albedo.matte.b, 0.0),
    );
}

// Demodulates light by albedo. Black surfaces reflect nothing.
fn over(light: vec3<f32>, albedo: vec3<f32>) -> vec3<f32> {
    const BLACK: vec3<f32> = vec3<f32>(1e-6);
    return select(vec3<f32>(0.0), light / max(albedo, BLACK), albedo > BLACK);
}

// Remodulates light, which is the inverse of `over`.
fn remodulated(light: SplitLight, albedo: Albedo) -> vec3<f32> {
    if !HAS_GLOSS {
        return light.matte * albedo.all;
    }
    return light.matte * albedo.matte + light.gloss * max(albedo.all - albedo.matte, vec3<f32>(0.0));
}

// Square of an invisible difference in luminance: 1e-10 of white.
fn unseen_square() -> f32 {
    return 1e-20 / (frame.display.storage_scale * frame.display.storage_scale);
}

// Luminances, clamped so that squares and sums of squares stay finite.
fn luminances(light: SplitLight) -> vec2<f32> {
    return min(vec2<f32>(luminance(light.matte), luminance(light.gloss)), vec2<f32>(1e18));
}
