// Temporal accumulation before and after the fit of BMFR (Koskela et al., "Blockwise Multi-Order Feature Regression for
// Real-Time Path-Tracing Reconstruction", ACM TOG 38(5), 2019, sections 3.1 and 3.4): the mean of all frames in which a
// surface was visible, and an exponential moving average once there are many such frames. History is reprojected as in
// `svgf/accumulate.wgsl`. Departures: the right eye falls back to the left eye's history, pixels that were not sampled
// keep their history, and the accumulations before and after the fit count their frames separately.

//!include frame grid projection motion pack mirrored history light_change bindings

// Variables:
// - `guide_image`: each pixel's surface in the previous frame: `guide` or, in dynamic scenes, `last_surface`.
// - `source`: demodulated illumination as floats; the last word is 0 if there is none.
// - `accumulated`: demodulated illumination as floats. The last word holds the material and, in its upper 8 bits, the
//   number of accumulated frames.

const MOST_FRAMES: f32 = 255.0;

struct Past {
    light: vec3<f32>,
    frames: f32,
    // Sum of the weights of the history pixels that show the same surface.
    found: f32,
}

fn past_at(seen: vec3<f32>, row: u32, eye: View, of_left: bool, before: Before, material: u32) -> Past {
    var past = Past();
    let around = pixels_around(seen, row, eye);
    for (var i = 0; i < 4; i += 1) {
        let corner = corner_of(around, i);
        var guide = last_guide[corner.at];
        var light = last_accumulated[corner.at];
        if of_left {
            guide = left_guide[corner.at];
            light = left_accumulated[corner.at];
        }
        let is_same = (light.w & MATERIAL_MASK) == material && shows(guide, before, around.reach);
        let w = select(0.0, corner.weight, is_same && (light.w >> 24u) != 0u);
        if w > 0.0 {
            past.light += bitcast<vec3<f32>>(light.xyz) * w;
            past.frames += f32(light.w >> 24u) * w;
            past.found += w;
        }
    }
    return past;
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
    if bits.w == NO_NORMAL {
        accumulated[at] = vec4<u32>(0u, 0u, 0u, material);
        return;
    }
    let before = surface_before(pixel, hit_image[at], bits);
    let now = bitcast<vec3<f32>>(source[at].xyz);
    let is_told = source[at].w != 0u;
    let is_new = is_told && is_finite(now);
    var dropped = is_told && !is_new;
    var past = Past();
    // Try the eye's own history, then the left eye's. A loop skips the second look-up, since software drivers do not
    // skip branches.
    let eyes = select(pass_.view + 1u, 0u, frame.history.rows == NO_HISTORY);
    for (var i = 0u; i < eyes && past.found < LEAST_FOUND; i += 1u) {
        let eye = previous.views[pass_.view - i];
        past = past_at(pixel_of(before.image, eye), pixel.y, eye, i == 1u, before, material);
        if !is_finite(past.light) {
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
    let least = bitcast<f32>(pass_.args[0]);
    let share = select(0.0, select(1.0, max(1.0 / (frames + 1.0), least), found), is_new);
    let light = past.light * scale * (1.0 - share) + select(vec3<f32>(0.0), now * share, is_new);
    let is_sound = is_finite(light);
    let count = select(0.0, clamp(round(frames + select(0.0, 1.0, is_new)), 1.0, MOST_FRAMES), (found || is_new) && is_sound);
    accumulated[at] = vec4<u32>(
        bitcast<vec3<u32>>(select(vec3<f32>(0.0), light, is_sound)),
        material | (u32(count) << 24u),
    );
    if dropped || !is_sound {
        tally_image[at] = add_tally(tally_image[at], 0u, 1u);
    }
}
