// Light that another view sampled on a pixel's surface.

//!include frame split pack foveation reprojection bindings

struct Gathered {
    matte: MeanLight,
    gloss: MeanLight,
    // Sum of the taps' variances, by weight.
    variance: vec2<f32>,
    // TELLS_VARIANCE if all taps tell their variance.
    told: u32,
    // Sum of the weights of valid taps.
    sum: f32,
    // The reason that the invalid tap with the largest weight is not valid.
    why: u32,
    // Whether the mask of the other view left a tap out.
    was_skipped: bool,
}

// Least sum of weights of valid taps.
const LEAST_SUM: f32 = 1e-4;

// Returns the reason that a tap is not valid; 0 if it is valid.
fn why_not(tap: Tap, wanted: Wanted) -> u32 {
    let why = surface_differs(tap, wanted);
    if SPARSE && why == 0u && left_radiance[tap.at].w == 0u {
        return SKIPPED;
    }
    return why;
}

// Gathers the light of a surface around image point `seen` of the other view, for a pixel in this row.
fn gathered(seen: vec2<f32>, row: u32, wanted: Wanted) -> Gathered {
    var found = Gathered();
    found.told = TELLS_VARIANCE;
    found.why = OUTSIDE;
    var missed = -1.0;
    for (var i = 0; i < taps(); i += 1) {
        let tap = tap_around(seen, row, i);
        let why = why_not(tap, wanted);
        found.was_skipped = found.was_skipped || why == SKIPPED;
        if why != 0u {
            found.why = select(found.why, why, tap.weight > missed);
            missed = max(missed, tap.weight);
        } else if tap.weight > 0.0 {
            let bits = left_radiance[tap.at];
            let light = unpack_sampled(bits);
            found.matte = with_light(found.matte, light.matte, tap.weight);
            found.gloss = with_light(found.gloss, light.gloss, tap.weight);
            found.variance += light.a * tap.weight;
            found.sum += tap.weight;
            found.told &= bits.w;
        }
    }
    return found;
}

fn pack_gathered(found: Gathered) -> vec4<u32> {
    let matte = mean_light(found.matte, 0.0);
    let gloss = mean_light(found.gloss, 0.0);
    if found.told != 0u {
        return pack_sampled_with(matte, gloss, found.variance / found.sum);
    }
    return pack_sampled(matte, gloss);
}
