// Edge-avoiding à-trous wavelet filter (Dammertz et al., HPG 2010) with B3-spline taps. As in Peres, the distance
// between taps halves from iteration to iteration, from 2^(count - 1) to 1. Departures:
// - The position weight measures the distance from the plane through the centre pixel's surface, relative to that
//   surface's distance from the eye. It depends neither on the scene's scale nor on how obliquely a surface is seen.
// - Radiance is compared after compression by c / (1 + luminance).
// - Specular and diffuse radiance are filtered side by side if the scene has gloss. Channels that a surface does not
//   reflect have no weight.
// If a sampling mask leaves pixels to the filter, the last word of `source` is Peres's binary mask (equation 4.2):
// SAMPLED once any sample has contributed to the pixel, else 0. With foveation, a layer with K iterations takes part in the last K.
// Departures:
// - Pixels that were not sampled stay empty until enough of their surface is within reach.
// - Pixels that are still empty in the last iteration take the mean of any surfaces within reach.

//!include frame grid projection split pack foveation edges bindings

// Threshold for filling an empty pixel: the sum of its taps' weights must exceed this value times the sampling
// probability. Below it, the pixel waits for the closer taps of a later iteration, since it would pass on the light of
// a few far taps as if it were its own. On a fully sampled plane the sum is 0.86.
const ENOUGH: f32 = 0.5;
// Minimum weight of a tap on any surface, for a pixel that is still empty in the last iteration.
const LAST_RESORT: f32 = 1e-6;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let bits = guide_image[at];
    if bits.w == NO_NORMAL {
        filtered[at] = source[at];
        return;
    }
    let centre = unpack_light(source[at]);
    let has_light = source[at].w != 0u;
    let step = i32(pass_.args.step);
    var inverse_sigma2 = pass_.args.inverse_sigma2;
    let guide = guide_for(bits, frame.camera.views[pass_.view].origin, 0.02);
    let colour = comparable(unmarked(centre.matte));
    let gloss_colour = comparable(unmarked(centre.gloss));
    var kernel = array<f32, 5>(0.0625, 0.25, 0.375, 0.25, 0.0625);
    // A centre that is sampled always counts, so the sum of weights cannot vanish.
    var weight = 0.375 * 0.375;
    var last_dy = 2;
    var least = 0.0;
    if SPARSE {
        let left = firstTrailingBit(pass_.args.step) + 1u;
        var own = frame.foveation.layer_iterations[INNER];
        if FOVEATED {
            own = frame.foveation.layer_iterations[layer_of(pixel, pass_.view)];
            last_dy = select(-3, 2, left <= own);
        }
        // An empty pixel has no radiance to compare with.
        inverse_sigma2 = select(0.0, inverse_sigma2, has_light && own - left >= pass_.args.blind);
        weight = select(0.0, weight, has_light);
        least = select(LAST_RESORT, 0.0, has_light || step != 1);
    }
    // Nor has a lobe without light.
    let inverse_sigmas2 = inverse_sigma2 * lobes_of(centre);
    var matte = MeanLight();
    var gloss = MeanLight();
    matte = with_light(matte, centre.matte, weight);
    gloss = with_light(gloss, centre.gloss, weight);
    for (var dy = -2; dy <= last_dy; dy += 1) {
        for (var dx = -2; dx <= 2; dx += 1) {
            let there = beside(pixel, vec2<i32>(dx, dy) * step);
            let tap = pixel_index(vec2<u32>(there.pixel));
            let value = unpack_light(source[tap]);
            let tap_bits = guide_image[tap];
            var counts = there.is_there && (dx != 0 || dy != 0);
            if SPARSE {
                counts = counts && source[tap].w != 0u && tap_bits.w != NO_NORMAL;
            }
            let k = select(0.0, kernel[dx + 2] * kernel[dy + 2], counts);
            let w = k * max(edge_weight(guide, colour, tap_bits, unmarked(value.matte), inverse_sigmas2.x), least);
            matte = with_light(matte, value.matte, w);
            weight += w;
            if HAS_GLOSS {
                let w = k * max(edge_weight(guide, gloss_colour, tap_bits, unmarked(value.gloss), inverse_sigmas2.y), least);
                gloss = with_light(gloss, value.gloss, w);
            }
        }
    }
    if SPARSE && last_dy < 0 {
        filtered[at] = source[at];
        return;
    }
    var mark = source[at].w;
    if SPARSE {
        let enough = select(ENOUGH * sampling_probability(pixel, pass_.view), 0.0, has_light || step == 1);
        mark = select(0u, SAMPLED, weight > enough);
        if mark == 0u {
            filtered[at] = vec4<u32>(0u);
            return;
        }
    }
    let least_weight = select(0.0, LEAST_WEIGHT, has_light);
    let light = SplitLight(mean_light(matte, least_weight), mean_light(gloss, least_weight), vec2<f32>(0.0));
    filtered[at] = vec4<u32>(pack_light(light).xyz, mark);
}
