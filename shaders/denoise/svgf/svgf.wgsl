// One iteration of the à-trous filter guided by variance (Schied et al. 2017): luminance may differ in proportion to
// its standard deviation, and variance is filtered along with the light. With foveation, a layer of K iterations takes
// part in the first K, which have the smallest steps. Departures:
// - 3x3 taps instead of 5x5: after 16 frames at one sample per pixel, both eyes are closer to a reference (FLIP falls
//   by 4 to 5 %), at less than half the cost and half the halo.
// - Surfaces are distinguished by the distance from the centre's plane, as in `atrous.wgsl`, instead of by depth
//   gradients.
// - Specular and diffuse radiance are filtered side by side if the scene has gloss, each by its own luminance and
//   variance (the paper separates direct and indirect light instead).
// - Differences are relative to the variances of both pixels, so that weights are symmetric. Weights are Gaussian,
//   which is near 1 within the noise and falls faster beyond it.
// - The first iteration, whose result becomes the history, tolerates larger differences than the others, since its taps
//   are the nearest.

//!include frame grid projection split pack foveation edges variance place bindings

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let place = place_of(id, group.x, groups.x, lane, UNFINISHED_GROUP);
    if !place.is_there {
        return;
    }
    let pixel = place.pixel;
    let at = pixel_index(pixel);
    let centre = unpack_light(source[at]);
    let bits = guide_image[at];
    if bits.w == NO_NORMAL {
        filtered[at] = source[at];
        return;
    }
    let step = 1 << pass_.args.iteration;
    let guide = guide_for(bits, frame.camera.views[pass_.view].origin, 0.02);
    let is_missing = centre.a.x < 0.0;
    let own = luminances(centre);
    // A lobe without light takes any light of its surface.
    let takes_any = vec2<bool>(is_missing || is_absent(centre.matte), is_missing || is_absent(centre.gloss));
    let sigma2 = pass_.args.sigma2;
    var kernel = array<f32, 3>(0.25, 0.5, 0.25);
    var weight = select(0.25, 0.0, is_missing);
    var matte = MeanLight();
    var gloss = MeanLight();
    matte = with_light(matte, centre.matte, weight);
    gloss = with_light(gloss, centre.gloss, weight);
    var lobes = lobes_of(centre) * weight;
    var variance = max(centre.a, vec2<f32>(0.0)) * weight * weight;
    var last_dy = 1;
    if FOVEATED {
        last_dy = select(-2, 1, pass_.args.iteration < frame.foveation.layer_iterations[layer_of(pixel, pass_.view)]);
    }
    for (var dy = -1; dy <= last_dy; dy += 1) {
        for (var dx = -1; dx <= 1; dx += 1) {
            let there = beside(pixel, vec2<i32>(dx, dy) * step);
            let tap = pixel_index(vec2<u32>(there.pixel));
            let value = unpack_light(source[tap]);
            let counts = there.is_there && (dx != 0 || dy != 0) && (value.a.x >= 0.0 || value.a.x == FINISHED);
            let tap_variance = max(value.a, vec2<f32>(0.0));
            let l = luminances(value);
            let off2 = (own - l) * (own - l) / (sigma2 * (max(centre.a, vec2<f32>(0.0)) + tap_variance) + 1e-6 * own * l + UNSEEN_SQUARE);
            let d = select(off2, vec2<f32>(0.0), takes_any);
            let taps = vec2<f32>(surface_weight(guide, guide_image[tap], d.x), surface_weight(guide, guide_image[tap], d.y));
            let k = select(vec2<f32>(0.0), kernel[dx + 1] * kernel[dy + 1] * taps, counts);
            matte = with_light(matte, value.matte, k.x);
            gloss = with_light(gloss, value.gloss, k.y);
            variance += tap_variance * k * k;
            lobes += lobes_of(value) * k;
            weight += k.x;
        }
    }
    if FOVEATED && last_dy < 0 {
        filtered[at] = source[at];
        return;
    }
    let least = select(LEAST_WEIGHT, 0.0, is_missing);
    let scale = select(vec2<f32>(0.0), 1.0 / lobes, lobes > vec2<f32>(least));
    let known = select(vec2<f32>(MISSING), variance * scale * scale, weight > 0.0);
    filtered[at] = pack_light(SplitLight(mean_light(matte, least), mean_light(gloss, least), known));
}
