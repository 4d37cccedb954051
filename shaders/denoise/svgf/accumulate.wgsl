// Temporal accumulation (Schied et al., "Spatiotemporal Variance-Guided Filtering", HPG 2017): the history of a pixel's
// surface is reprojected along its motion and blended with this frame's light. Departures:
// - Means and variances are weighted by samples (West 1979), so that frames of few and of many samples mix correctly.
// - If the first frame has several samples per pixel, their variance is measured. Later frames contribute only their
//   means, which differ less from one another than means of independent samples would.
// - Variance is inflated if there are few observations, which may have missed rare bright light, and if the observations
//   are samples of few frames, since the filter would leave speckle: it prefers neighbours of similar light, so its means
//   vary more than their variances say, until history has averaged them.
// - The length of history is bounded by the blur of resampling, and by the difference of the recent mean from the long
//   one.
// - If the scene has gloss, specular radiance is accumulated separately from diffuse radiance, over fewer frames.
// - In dynamic scenes, history is dropped in proportion to the change of light (Schied et al. 2018, see
//   `gradient.wgsl`).
// - If the right eye finds no history, the left eye's is used.
// - Channels that a surface does not reflect keep their history, and pixels without a lobe are no history of pixels with
//   it.
// - If a pixel shows no surface at its centre, its samples may still have hit one beside it. Their light passes the filter
//   unchanged.

//!include frame grid projection split pack samples motion mirrored variance history light_change bindings

// Variables:
// - `guide_image`: each pixel's surface in the previous frame: `guide` or, in dynamic scenes, `last_surface`.
// - `radiance`: demodulated illumination; alpha is 0 if the pixel was not sampled.
// - `accumulated`: accumulated light with the variance of its luminance, or UNKNOWN or MISSING instead (see
//   `variance.inc.wgsl`).
// - `moments`: words x and y hold the mean luminance and its variance per sample, as floats. If the scene has gloss,
//   each of these words holds a diffuse and a specular value as half floats, variances as standard deviations. The mean
//   of a lobe without light is ABSENT. Word z:
//   number of samples, and recent mean divided by `power_of_two_in(mean)`, as half floats. Word w: material and, in
//   the upper 8 bits, number of frames.

// Minimum number of observations for temporal variance: frames, as in the paper, or samples if their variance is known.
const FEW_FRAMES: f32 = 4.0;
// Number of observations at which the variance is doubled. It is inflated more for fewer observations.
const FEW_OBSERVATIONS: f32 = 24.0;
// Inflation of the variance of a single frame's samples, which falls with the square of the number of frames.
const FEW_MEANS: f32 = 2.0;
// Maximum history in frames: LONGEST_MOVED if the reprojected point lies between the centres of the previous frame's
// pixels, LONGEST_STILL if it lies on a centre, and LONGEST_VIEW_DEPENDENT for view-dependent light.
const LONGEST_MOVED: f32 = 32.0;
const LONGEST_STILL: f32 = 255.0;
const LONGEST_VIEW_DEPENDENT: f32 = 6.0;
// Maximum history in mirrors and behind glass in dynamic scenes, in frames.
const LONGEST_MIRRORED: f32 = 12.0;
// Number of frames in the recent mean, and number of standard deviations by which the recent mean may differ from the
// mean of the whole history.
const RECENT_FRAMES: f32 = 4.0;
const TRUSTED_DEVIATIONS: f32 = 3.0;

struct Past {
    light: MeanLight,
    gloss: MeanLight,
    // Mean and variance of the luminance of matte and of gloss, and the sum of the weights of taps with these lobes.
    mean: vec2<f32>,
    variance: vec2<f32>,
    lobes: vec2<f32>,
    recent: f32,
    samples: f32,
    frames: f32,
    // Sum of the taps' weights; 0 without history.
    found: f32,
}

struct Tap {
    guide: vec4<u32>,
    moments: vec4<u32>,
    light: SplitLight,
}

fn tap_at(at: u32, of_left: bool) -> Tap {
    if of_left {
        return Tap(left_guide[at], left_moments[at], unpack_light(left_history[at]));
    }
    return Tap(last_guide[at], last_moments[at], unpack_light(last_history[at]));
}

struct Known {
    mean: vec2<f32>,
    variance: vec2<f32>,
}

fn unpack_moments(bits: vec2<u32>) -> Known {
    if !HAS_GLOSS {
        return Known(vec2<f32>(bitcast<f32>(bits.x), 0.0), vec2<f32>(bitcast<f32>(bits.y), 0.0));
    }
    return Known(unpack2x16float(bits.x), unpack_deviations(bits.y));
}

fn pack_moments(known: Known) -> vec2<u32> {
    if !HAS_GLOSS {
        return bitcast<vec2<u32>>(vec2<f32>(known.mean.x, known.variance.x));
    }
    return vec2<u32>(pack_pair(known.mean.x, known.mean.y), pack_deviations(known.variance));
}

// Largest power of two that is at most `mean`, or the smallest one. Luminances near the mean, divided by it, are near 1 in
// any unit of light.
fn power_of_two_in(mean: f32) -> f32 {
    return bitcast<f32>(max(bitcast<u32>(max(mean, 0.0)) & 0x7f800000u, 0x00800000u));
}

// Maximum history of specular radiance in frames, once the eye has moved. Specular radiance changes faster on smoother
// surfaces.
fn gloss_longest(hit: u32) -> f32 {
    let roughness = f32((hit >> ROUGHNESS_SHIFT) & 63u) / ROUGHNESS_STEPS;
    return mix(LONGEST_VIEW_DEPENDENT, LONGEST_MOVED, min(2.0 * roughness, 1.0));
}

// 1 for each lobe with a mean luminance, 0 for one that is absent.
fn lobes_in(mean: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(1.0), vec2<f32>(0.0), absent(mean.xyy).xy);
}

// History of the surface, around image point `seen` of the previous frame, that has the lobes of this frame's light.
fn past_at(seen: vec3<f32>, row: u32, eye: View, of_left: bool, before: Before, material: u32, lobes: vec2<f32>) -> Past {
    var past = Past();
    let around = pixels_around(seen, row, eye);
    for (var i = 0; i < 4; i += 1) {
        let corner = corner_of(around, i);
        let tap = tap_at(corner.at, of_left);
        let is_same = (tap.moments.w & MATERIAL_MASK) == material && shows(tap.guide, before, around.reach);
        let half = unpack2x16float(tap.moments.z);
        let known = unpack_moments(tap.moments.xy);
        let tap_lobes = lobes_in(known.mean);
        let is_history = is_same && (tap.moments.z & 0xffffu) != 0u && all(tap_lobes >= lobes);
        let w = select(0.0, corner.weight, is_history);
        if w > 0.0 {
            past.light = with_light(past.light, tap.light.matte, w);
            past.gloss = with_light(past.gloss, tap.light.gloss, w);
            let has_lobe = tap_lobes > vec2<f32>(0.0);
            past.mean += select(vec2<f32>(0.0), known.mean * w, has_lobe);
            past.variance += select(vec2<f32>(0.0), known.variance * w, has_lobe);
            past.lobes += tap_lobes * w;
            past.recent += half.y * power_of_two_in(known.mean.x) * tap_lobes.x * w;
            past.samples += half.x * w;
            past.frames += f32(tap.moments.w >> 24u) * w;
            past.found += w;
        }
    }
    return past;
}

fn is_finite_light(light: SplitLight) -> bool {
    return is_finite(light.matte) && is_finite(light.gloss) && is_finite(light.a.xyy);
}

fn is_finite_past(past: Past) -> bool {
    return is_finite(past.light.sum) && is_finite(past.gloss.sum) && is_finite(vec3<f32>(past.mean, past.recent))
        && is_finite(vec3<f32>(past.variance, past.samples));
}

fn count_dropped(at: u32, dropped: bool) {
    if dropped {
        tally_image[at] = add_tally(tally_image[at], 0u, 1u);
    }
}

// Writes a pixel without light or history.
fn leave_nothing(at: u32, material: u32, dropped: bool) {
    accumulated[at] = pack_light(SplitLight(vec3<f32>(0.0), vec3<f32>(0.0), vec2<f32>(MISSING)));
    moments[at] = vec4<u32>(0u, 0u, 0u, material);
    count_dropped(at, dropped);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let bits = guide_image[at];
    let hit = hit_image[at].w;
    let material = hit & MATERIAL_MASK;
    var now = unpack_sampled(radiance[at]);
    let tells_variance = (radiance[at].w & TELLS_VARIANCE) != 0u;
    var sampled = radiance[at].w != 0u;
    var dropped = false;
    if !is_finite_light(now) {
        now = SplitLight(vec3<f32>(0.0), vec3<f32>(0.0), vec2<f32>(0.0));
        sampled = false;
        dropped = true;
    }
    if bits.w == NO_NORMAL {
        accumulated[at] = pack_light(SplitLight(unmarked(now.matte), unmarked(now.gloss), vec2<f32>(0.0)));
        moments[at] = vec4<u32>(0u, 0u, 0u, material);
        count_dropped(at, dropped);
        return;
    }
    let before = surface_before(pixel, hit_image[at], bits);
    // Lobes that this frame's light has.
    let lobes = select(vec2<f32>(0.0), lobes_of(now), sampled);
    var past = Past();
    var fraction = vec2<f32>(0.0);
    // Try the eye's own history, then the left eye's. A loop skips the second look-up, since software drivers do not
    // skip branches.
    let eyes = select(pass_.view + 1u, 0u, frame.history.rows == NO_HISTORY);
    for (var i = 0u; i < eyes && past.found < LEAST_FOUND; i += 1u) {
        let eye = pass_.view - i;
        let seen = pixel_of(before.image, previous.views[eye]);
        past = past_at(seen, pixel.y, previous.views[eye], i == 1u, before, material, lobes);
        if !is_finite_past(past) {
            past = Past();
            dropped = true;
        }
        let column = column_in(i32(seen.y), seen.x, previous.views[eye].fovea_rows);
        fraction = fract(vec2<f32>(column, seen.y) - frame.camera.centre);
    }
    if past.found < LEAST_FOUND {
        past = Past();
    }
    let scale = select(0.0, 1.0 / past.found, past.found > 0.0);
    var samples = past.samples * scale;
    var frames = past.frames * scale;
    // The right eye has samples of the left eye at other places.
    let new_samples = select(0.0, select(mean_samples(), f32(samples_of(pixel)), pass_.view == 0u), sampled);
    // Resampling blurs most between pixels.
    let between = 4.0 * max(fraction.x * (1.0 - fraction.x), fraction.y * (1.0 - fraction.y));
    var longest = mix(LONGEST_STILL, LONGEST_MOVED, min(2.0 * between, 1.0));
    // In dynamic scenes, reflections change even if the eye does not move.
    let eye_moved = HAS_MOTION || any(previous.views[pass_.view].origin != frame.camera.views[pass_.view].origin);
    if !HAS_GLOSS && (hit & FLAG_VIEW_DEPENDENT) != 0u && eye_moved {
        longest = LONGEST_VIEW_DEPENDENT;
    }
    // There are no temporal gradients in mirrors and on polished surfaces, whose roughness is 0.
    let is_polished = HAS_POLISH && HAS_GLOSS && ((hit >> ROUGHNESS_SHIFT) & 63u) == 0u;
    if HAS_MOTION && (is_mirrored(hit_image[at]) || is_polished) {
        longest = min(longest, LONGEST_MIRRORED);
    }
    longest = min(longest, longest_in_light());
    var keep = min(longest / max(frames, 1.0), 1.0);
    if HAS_MOTION && !IS_POLAR {
        keep *= kept_in_light(tile_of(pixel, before.image), samples * keep, max(new_samples, 1.0));
    }
    samples *= keep;
    frames *= keep;
    let total = samples + new_samples;
    if total <= 0.0 {
        leave_nothing(at, material, dropped);
        return;
    }
    let alpha = new_samples / total;
    // Specular radiance uses fewer of these frames.
    var alphas = vec2<f32>(alpha);
    var totals = vec2<f32>(total);
    if HAS_GLOSS {
        let gloss_keep = select(1.0, min(gloss_longest(hit) / max(frames, 1.0), 1.0), eye_moved);
        totals.y = samples * gloss_keep + new_samples;
        alphas.y = select(0.0, new_samples / totals.y, totals.y > 0.0);
    }
    // A lobe without light keeps its history.
    alphas *= lobes;
    let had_lobe = past.lobes > vec2<f32>(LEAST_FOUND);
    let lobe_scale = select(vec2<f32>(0.0), 1.0 / past.lobes, had_lobe);
    let value = luminances(now);
    let old_mean = past.mean * lobe_scale;
    let difference = value - old_mean;
    let mean = old_mean + alphas * difference;
    let moved = difference * (value - mean);
    let fresh = select(new_samples * moved, now.a, tells_variance && samples == 0.0);
    let variance = mix(past.variance * lobe_scale, fresh, alphas);
    let recent = mix(past.recent * lobe_scale.x, value.x, max(alphas.x, select(0.0, 1.0 / RECENT_FRAMES, sampled) * lobes.x));
    frames += select(0.0, 1.0, sampled);
    // Light has changed if the recent mean differs from the long one by more than the variance of both explains. Recent
    // frames may have fewer samples than others, so the smallest known sample count is assumed for each.
    let fewest = min(total / frames, f32(min(frame.sampling.samples.least, previous.sampling.samples.least)));
    let spread = variance.x * (1.0 / ((2.0 * RECENT_FRAMES - 1.0) * fewest) + 1.0 / total);
    let off = (recent - mean.x) * (recent - mean.x) / max(TRUSTED_DEVIATIONS * TRUSTED_DEVIATIONS * spread, UNSEEN_SQUARE);
    let trust = select(1.0, max(1.0 / off, min(FEW_FRAMES / frames, 1.0)), off > 1.0 && frames > FEW_FRAMES);
    let observations = select(frames, total, tells_variance);
    let means = max(frames, 1.0);
    let doubt = 1.0 + FEW_OBSERVATIONS / observations + select(0.0, FEW_MEANS / (means * means), tells_variance);
    let known = variance / totals * observations / max(observations - 1.0, 1.0) * doubt;
    let light = SplitLight(
        blended(mean_light(past.light, LEAST_FOUND), now.matte, alphas.x),
        blended(mean_light(past.gloss, LEAST_FOUND), now.gloss, alphas.y),
        select(vec2<f32>(UNKNOWN), known, observations > FEW_FRAMES - 0.5),
    );
    if !(is_finite_light(light) && is_finite(vec3<f32>(variance, recent))) {
        leave_nothing(at, material, true);
        return;
    }
    let has_lobe = (lobes > vec2<f32>(0.0)) | had_lobe;
    let packed = pack_moments(Known(select(absent_light().xy, mean, has_lobe), variance));
    let unit = power_of_two_in(unpack_moments(packed).mean.x);
    let half = pack_pair(total * trust, recent / unit);
    let count = u32(clamp(round(frames * trust), 1.0, 255.0));
    accumulated[at] = pack_light(light);
    moments[at] = vec4<u32>(packed, half, material | (count << 24u));
    count_dropped(at, dropped);
}
