// Variance that guides the filter (Schied et al. 2017): temporal variance is smoothed over 3x3 pixels. If history is
// short, variance is estimated from 7x7 pixels of the same surface, whose mean then replaces the pixel's own light, as
// in the authors' code. The variance of specular radiance is computed separately, from the same pixels. Departures: the
// 3x3 smoothing runs once, before the first iteration, instead of in each; and spatial estimates are multiplied by
// DOUBT, since they may have missed rare bright light.

//!include frame grid projection split pack edges variance place bindings

const REACH: i32 = i32(VARIANCE_REACH);
// Factor by which spatial estimates of variance are multiplied.
const DOUBT: f32 = 9.0;
// Minimum weight of a tap on any surface, for a pixel that has no light of its own.
const LAST_RESORT: f32 = 1e-6;

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
    let is_known = centre.a.x >= 0.0;
    let own_lobes = lobes_of(centre);
    var smooth_sum = max(centre.a, vec2<f32>(0.0)) * 0.25;
    var smooth_weight = own_lobes * 0.25;
    let near = select(-1, 1, is_known);
    for (var dy = -near; dy <= near; dy += 1) {
        for (var dx = -1; dx <= 1; dx += 1) {
            let there = beside(pixel, vec2<i32>(dx, dy));
            let value = unpack_light(source[pixel_index(vec2<u32>(there.pixel))]);
            let k = select(0.0625, 0.125, dx == 0 || dy == 0);
            let w = select(0.0, k, there.is_there && value.a.x >= 0.0 && (dx != 0 || dy != 0)) * lobes_of(value);
            smooth_sum += max(value.a, vec2<f32>(0.0)) * w;
            smooth_weight += w;
        }
    }
    let guide = guide_for(bits, frame.camera.views[pass_.view].origin, 0.02);
    let is_missing = centre.a.x == MISSING;
    let is_there = select(1.0, 0.0, is_missing);
    var matte = MeanLight();
    var gloss = MeanLight();
    matte = with_light(matte, centre.matte, is_there);
    gloss = with_light(gloss, centre.gloss, is_there);
    var weight = is_there;
    var lobes = own_lobes * is_there;
    let own = luminances(centre) * is_there;
    var first = own;
    var second = own * own;
    let far = select(REACH, -1, is_known);
    for (var dy = -far; dy <= far; dy += 1) {
        for (var dx = -REACH; dx <= REACH; dx += 1) {
            let there = beside(pixel, vec2<i32>(dx, dy));
            let tap = pixel_index(vec2<u32>(there.pixel));
            let value = unpack_light(source[tap]);
            let counts = there.is_there && (dx != 0 || dy != 0) && value.a.x != MISSING;
            let tap_bits = guide_image[tap];
            let least = select(0.0, LAST_RESORT, is_missing && tap_bits.w != NO_NORMAL);
            let w = select(0.0, max(surface_weight(guide, tap_bits, 0.0), least), counts);
            let l = luminances(value);
            matte = with_light(matte, value.matte, w);
            gloss = with_light(gloss, value.gloss, w);
            first += l * w;
            second += l * l * w;
            weight += w;
            lobes += lobes_of(value) * w;
        }
    }
    let least_weight = select(LEAST_WEIGHT, 0.0, is_missing);
    let scale = select(vec2<f32>(0.0), 1.0 / lobes, lobes > vec2<f32>(least_weight));
    let mean = first * scale;
    let spatial = DOUBT * max(second * scale - mean * mean, vec2<f32>(0.0));
    let smooth_variance = smooth_sum / max(smooth_weight, vec2<f32>(0.0625));
    let variance = select(spatial, smooth_variance, is_known);
    filtered[at] = pack_light(SplitLight(
        select(mean_light(matte, least_weight), centre.matte, is_known),
        select(mean_light(gloss, least_weight), centre.gloss, is_known),
        select(vec2<f32>(MISSING), variance, weight > 0.0),
    ));
}
