// Display encoding of linear light: exposure, tone curve, sRGB. `image/tone.rs` cites the sources of the curves.

//!include frame

fn tone_neutral(exposed: vec3<f32>) -> vec3<f32> {
    const START = 0.76;
    let least = min(exposed.r, min(exposed.g, exposed.b));
    let c = exposed - select(0.04, least - 6.25 * least * least, least < 0.08);
    let peak = max(c.r, max(c.g, c.b));
    if peak < START {
        return c;
    }
    let d = 1.0 - START;
    let new_peak = 1.0 - d * d / (peak + d - START);
    let white = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0);
    return mix(c * (new_peak / peak), vec3<f32>(new_peak), white);
}

// Matrices are in columns.
fn tone_aces(exposed: vec3<f32>) -> vec3<f32> {
    let into = mat3x3<f32>(0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777);
    let out_of = mat3x3<f32>(1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602);
    let v = into * (min(exposed, vec3<f32>(1e6)) / 0.6);
    return out_of * ((v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.432951) + 0.238081));
}

fn tone_agx(exposed: vec3<f32>) -> vec3<f32> {
    const MIN_EV = -12.47393;
    const MAX_EV = 4.026069;
    let rec2020 = mat3x3<f32>(0.6274, 0.0691, 0.0164, 0.3293, 0.9195, 0.0880, 0.0433, 0.0113, 0.8956);
    let srgb = mat3x3<f32>(1.6605, -0.1246, -0.0182, -0.5876, 1.1329, -0.1006, -0.0728, -0.0083, 1.1187);
    let inset = mat3x3<f32>(
        0.856627153, 0.137318973, 0.111898213, 0.095121241, 0.761241991, 0.076799419, 0.048251606, 0.101439036, 0.811302368,
    );
    let outset = mat3x3<f32>(
        1.127100582, -0.141329763, -0.141329763, -0.110606643, 1.157823702, -0.110606643, -0.016493939, -0.016493939, 1.251936407,
    );
    let stops = log2(max(inset * (rec2020 * exposed), vec3<f32>(1e-10)));
    let x = clamp((stops - MIN_EV) / (MAX_EV - MIN_EV), vec3<f32>(0.0), vec3<f32>(1.0));
    let x2 = x * x;
    let x4 = x2 * x2;
    let curve = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;
    return srgb * pow(max(outset * curve, vec3<f32>(1e-10)), vec3<f32>(2.2));
}

fn display_code(color: vec3<f32>) -> u32 {
    // Clamped, so that the quotient is at most 1.
    let exposed = clamp(color, vec3<f32>(0.0), vec3<f32>(1e18)) * frame.display.exposure;
    var c = exposed / (1.0 + exposed);
    switch frame.display.tone {
        case TONE_NEUTRAL: {
            c = tone_neutral(exposed);
        }
        case TONE_ACES: {
            c = tone_aces(exposed);
        }
        case TONE_AGX: {
            c = tone_agx(exposed);
        }
        case TONE_NONE: {
            c = exposed;
        }
        default: {}
    }
    let encoded = select(1.055 * pow(max(c, vec3<f32>(1e-9)), vec3<f32>(1.0 / 2.4)) - 0.055, c * 12.92, c <= vec3<f32>(0.0031308));
    return pack4x8unorm(vec4<f32>(encoded, 1.0));
}
