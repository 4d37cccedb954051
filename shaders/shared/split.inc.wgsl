// Diffuse radiance of a surface's Lambertian lobe (matte) and specular radiance of its facets (gloss), which are
// filtered separately if the scene has gloss. Both are then packed into one pixel of half floats. Otherwise `matte`
// holds all radiance, as floats. Either format stores light in units in which white is near 1 at the exposure of the run:
// `scaled` converts radiance to them where it is traced, and `remodulated` converts it back. The factor is a power of two,
// so neither conversion rounds.

//!include frame

override HAS_GLOSS: bool = true;

// Whether light of channels that a surface does not reflect is ABSENT. Filters then give these channels no weight: as
// black light, they would darken the light of the surfaces around them. Otherwise it is 0.
override MARKS_ABSENT: bool = false;

// Light of a channel that the surface does not reflect, so that light over albedo is unknown. Any negative light means
// the same.
const ABSENT: f32 = -1.0;

// Light of a surface that reflects no channel.
fn absent_light() -> vec3<f32> {
    if !MARKS_ABSENT {
        return vec3<f32>(0.0);
    }
    return vec3<f32>(ABSENT);
}

// True for each channel that is absent.
fn absent(light: vec3<f32>) -> vec3<bool> {
    if !MARKS_ABSENT {
        return vec3<bool>(false);
    }
    // Numbers below 0 by their bits, NaN not among them. LLVM would replace a comparison of floats that were just unpacked
    // by one of half floats, which CPUs execute one at a time.
    return bitcast<vec3<u32>>(light) - vec3<u32>(0x80000001u) < vec3<u32>(0x7f800000u);
}

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

// True if light is too bright to store. Packing clamps it to MOST_LIGHT.
fn is_clipped(matte: vec3<f32>, gloss: vec3<f32>) -> bool {
    return HAS_GLOSS && any(max(matte, gloss) > vec3<f32>(MOST_LIGHT));
}

fn pack_pair(a: f32, b: f32) -> u32 {
    return pack2x16float(min(vec2<f32>(a, b), vec2<f32>(MOST_LIGHT)));
}

// Converts radiance to the unit of stored light.
fn scaled(radiance: vec3<f32>) -> vec3<f32> {
    return radiance * frame.display.storage_scale;
}

fn unpack_light(bits: vec4<u32>) -> SplitLight {
    if !HAS_GLOSS {
        let all = bitcast<vec4<f32>>(bits);
        return SplitLight(all.rgb, vec3<f32>(0.0), vec2<f32>(all.a));
    }
    let y = unpack2x16float(bits.y);
    let matte = vec3<f32>(unpack2x16float(bits.x), y.x);
    let gloss = vec3<f32>(y.y, unpack2x16float(bits.z));
    return SplitLight(matte, gloss, unpack_deviations(bits.w));
}

fn pack_light(light: SplitLight) -> vec4<u32> {
    if !HAS_GLOSS {
        return bitcast<vec4<u32>>(vec4<f32>(light.matte, light.a.x));
    }
    return vec4<u32>(
        pack_pair(light.matte.r, light.matte.g),
        pack_pair(light.matte.b, light.gloss.r),
        pack_pair(light.gloss.g, light.gloss.b),
        pack_deviations(light.a),
    );
}

// Packs light that was sampled in this frame.
fn pack_sampled(matte: vec3<f32>, gloss: vec3<f32>) -> vec4<u32> {
    return vec4<u32>(pack_light(SplitLight(matte, gloss, vec2<f32>(0.0))).xyz, SAMPLED);
}

// Packs light with the variance of its samples.
fn pack_sampled_with(matte: vec3<f32>, gloss: vec3<f32>, variance: vec2<f32>) -> vec4<u32> {
    let bits = pack_light(SplitLight(matte, gloss, variance));
    return vec4<u32>(bits.xyz, bits.w | TELLS_VARIANCE);
}

// Unpacks light that was sampled in this frame, with the variance of its samples if stored.
fn unpack_sampled(bits: vec4<u32>) -> SplitLight {
    return unpack_light(vec4<u32>(bits.xyz, bits.w & ~TELLS_VARIANCE));
}

// Packs variances as standard deviations. Negative values (flags) stay.
fn pack_deviations(variances: vec2<f32>) -> u32 {
    let deviations = select(sqrt(max(variances, vec2<f32>(0.0))), variances, variances < vec2<f32>(0.0));
    return pack_pair(deviations.x, deviations.y);
}

fn unpack_deviations(bits: u32) -> vec2<f32> {
    let deviations = unpack2x16float(bits);
    // Sign bits are tested, as in `absent`.
    let is_flag = bitcast<vec2<i32>>(vec2<u32>(bits << 16u, bits)) < vec2<i32>(0);
    return select(deviations * deviations, deviations, is_flag);
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

// Demodulates light by albedo. Channels that the surface does not reflect have no light.
fn over(light: vec3<f32>, albedo: vec3<f32>) -> vec3<f32> {
    const BLACK: vec3<f32> = vec3<f32>(1e-6);
    // Rounding may leave slightly negative light.
    let lit = select(light, vec3<f32>(0.0), light < vec3<f32>(0.0));
    return select(absent_light(), lit / max(albedo, BLACK), albedo > BLACK);
}

// Light without marks: absent light is black.
fn unmarked(light: vec3<f32>) -> vec3<f32> {
    return select(light, vec3<f32>(0.0), absent(light));
}

// Remodulates light, which is the inverse of `over`, and returns its radiance.
fn remodulated(light: SplitLight, albedo: Albedo) -> vec3<f32> {
    let matte = unmarked(light.matte) / frame.display.storage_scale;
    if !HAS_GLOSS {
        return matte * albedo.all;
    }
    let gloss = unmarked(light.gloss) / frame.display.storage_scale;
    return matte * albedo.matte + gloss * max(albedo.all - albedo.matte, vec3<f32>(0.0));
}

// Sum of weights up to which a filter leaves a channel absent: the light is that of other surfaces.
const LEAST_WEIGHT: f32 = 1e-6;

// Weighted mean of light. Absent channels have no weight.
struct MeanLight {
    sum: vec3<f32>,
    weight: vec3<f32>,
}

fn with_light(mean: MeanLight, light: vec3<f32>, weight: f32) -> MeanLight {
    // Light that is not a number counts, so that it is found later.
    let w = select(vec3<f32>(weight), vec3<f32>(0.0), absent(light));
    return MeanLight(mean.sum + light * w, mean.weight + w);
}

// Channels whose weight is not above `least` are absent.
fn mean_light(mean: MeanLight, least: f32) -> vec3<f32> {
    return select(absent_light(), mean.sum / max(mean.weight, vec3<f32>(1e-30)), mean.weight > vec3<f32>(least));
}

// Square of an invisible difference in luminance.
const UNSEEN_SQUARE: f32 = 1e-20;

// Blends light with its history. If a channel is absent in one of them, the other takes its place.
fn blended(past: vec3<f32>, now: vec3<f32>, alpha: f32) -> vec3<f32> {
    let kept = select(mix(past, now, alpha), past, absent(now));
    return select(kept, now, absent(past));
}

// Whether a channel that the surface reflects is absent.
fn lacks_light(light: SplitLight, albedo: Albedo) -> bool {
    let matte = select(absent(light.matte), vec3<bool>(false), absent(over(vec3<f32>(0.0), albedo.matte)));
    let gloss = select(absent(light.gloss), vec3<bool>(false), absent(over(vec3<f32>(0.0), albedo.all - albedo.matte)));
    return any(matte | (gloss & vec3<bool>(HAS_GLOSS)));
}

// Whether all channels of a lobe are absent.
fn is_absent(light: vec3<f32>) -> bool {
    return all(absent(light));
}

// 1 for each lobe that has light, 0 for one that is absent.
fn lobes_of(light: SplitLight) -> vec2<f32> {
    return select(vec2<f32>(1.0), vec2<f32>(0.0), vec2<bool>(is_absent(light.matte), is_absent(light.gloss)));
}

// Luminance that a lobe would have if its absent channels were as bright as the others; 0 if all are absent.
fn lobe_luminance(light: vec3<f32>) -> f32 {
    let marked = absent(light);
    let known = luminance(select(vec3<f32>(1.0), vec3<f32>(0.0), marked));
    let sum = luminance(unmarked(light));
    return select(sum, sum / max(known, 1e-3), any(marked));
}

// Luminances, clamped so that squares and sums of squares stay finite.
fn luminances(light: SplitLight) -> vec2<f32> {
    return min(vec2<f32>(lobe_luminance(light.matte), lobe_luminance(light.gloss)), vec2<f32>(1e18));
}
