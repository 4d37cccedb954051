// Temporal accumulation before and after the fit of BMFR (Koskela et al., "Blockwise Multi-Order Feature Regression for
// Real-Time Path-Tracing Reconstruction", ACM TOG 38(5), 2019, sections 3.1 and 3.4): the mean of all frames in which a
// surface was visible, and an exponential moving average once there are many such frames. History is reprojected as in
// `svgf/accumulate.wgsl`. Departures: the right eye falls back to the left eye's history, pixels that were not sampled
// and channels that a surface does not reflect keep their history, and the accumulations before and after the fit count
// their frames separately.

//!include frame grid projection split pack motion history light_change bindings

// Variables:
// - `guide_image`: each pixel's surface in the previous frame: `guide` or, in dynamic scenes, `last_surface`.
// - `source`: demodulated illumination; the last word is 0 if there is none.
// - `accumulated`: demodulated illumination. The last word holds the material and, in its upper 8 bits, the number of
//   accumulated frames.

const MOST_FRAMES: f32 = 255.0;

struct Past {
    matte: MeanLight,
    gloss: MeanLight,
    frames: f32,
    // Sum of the weights of the history pixels that show the same surface.
    found: f32,
}

fn past_at(seen: vec3<f32>, row: u32, eye: View, of_left: bool, before: Before, material: u32, lobes: vec2<f32>) -> Past {
    var past = Past();
    let around = pixels_around(seen, row, eye);
    for (var i = 0; i < 4; i += 1) {
        let corner = corner_of(around, i);
        var guide = last_guide[corner.at];
        var bits = last_accumulated[corner.at];
        if of_left {
            guide = left_guide[corner.at];
            bits = left_accumulated[corner.at];
        }
        let light = unpack_light(vec4<u32>(bits.xyz, 0u));
        let is_same = (bits.w & MATERIAL_MASK) == material && shows(guide, before, around.reach);
        let w = select(0.0, corner.weight, is_same && (bits.w >> 24u) != 0u && all(lobes_of(light) >= lobes));
        if w > 0.0 {
            past.matte = with_light(past.matte, light.matte, w);
            past.gloss = with_light(past.gloss, light.gloss, w);
            past.frames += f32(bits.w >> 24u) * w;
            past.found += w;
        }
    }
    return past;
}

fn count_dropped(at: u32, dropped: bool) {
    if dropped {
        tally_image[at] = add_tally(tally_image[at], 0u, 1u);
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let bits = guide_image[at];
    let material = hit_image[at].w & MATERIAL_MASK;
    let now = unpack_light(vec4<u32>(source[at].xyz, 0u));
    let is_told = source[at].w != 0u;
    let is_new = is_told && is_finite(now.matte) && is_finite(now.gloss);
    if bits.w == NO_NORMAL {
        // Samples beside the pixel's centre may have hit a surface.
        accumulated[at] = vec4<u32>(select(vec3<u32>(0u), source[at].xyz, is_new), material);
        count_dropped(at, is_told && !is_new);
        return;
    }
    let before = surface_before(pixel, hit_image[at], bits);
    // Lobes that this frame's light has.
    let lobes = select(vec2<f32>(0.0), lobes_of(now), is_new);
    var dropped = is_told && !is_new;
    var past = Past();
    // Try the eye's own history, then the left eye's. A loop skips the second look-up, since software drivers do not
    // skip branches.
    let eyes = select(pass_.view + 1u, 0u, frame.history.rows == NO_HISTORY);
    for (var i = 0u; i < eyes && past.found < LEAST_FOUND; i += 1u) {
        let eye = previous.views[pass_.view - i];
        past = past_at(pixel_of(before.image, eye), pixel.y, eye, i == 1u, before, material, lobes);
        if !(is_finite(past.matte.sum) && is_finite(past.gloss.sum)) {
            past = Past();
            dropped = true;
        }
    }
    let found = past.found >= LEAST_FOUND;
    let scale = select(0.0, 1.0 / max(past.found, LEAST_FOUND), found);
    var frames = min(past.frames * scale, longest_in_light());
    if HAS_MOTION && !IS_POLAR {
        frames *= kept_in_light(tile_of(pixel, before.image), frames, 1.0);
    }
    // Minimum blend weight of this frame.
    let least = pass_.args.least_fraction;
    let share = select(0.0, select(1.0, max(1.0 / (frames + 1.0), least), found), is_new);
    var matte = vec3<f32>(0.0);
    var gloss = vec3<f32>(0.0);
    if found {
        matte = mean_light(past.matte, LEAST_FOUND);
        gloss = mean_light(past.gloss, LEAST_FOUND);
    }
    if is_new {
        matte = select(now.matte, blended(matte, now.matte, share), found);
        gloss = select(now.gloss, blended(gloss, now.gloss, share), found);
    }
    let is_sound = is_finite(matte) && is_finite(gloss);
    let count = select(0.0, clamp(round(frames + select(0.0, 1.0, is_new)), 1.0, MOST_FRAMES), (found || is_new) && is_sound);
    let light = pack_light(SplitLight(matte, gloss, vec2<f32>(0.0)));
    accumulated[at] = vec4<u32>(select(vec3<u32>(0u), light.xyz, is_sound), material | (u32(count) << 24u));
    count_dropped(at, dropped || !is_sound);
}
