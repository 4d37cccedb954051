// Temporal antialiasing (TAA; Karis, "High Quality Temporal Supersampling", SIGGRAPH 2014 courses; Salvi, "An Excursion
// in Temporal Supersampling", GDC 2016): each frame's rays are jittered within the pixel, and frames are averaged along
// motion vectors. History is clamped to the range of the pixel's neighbourhood. Departures: linear light is averaged,
// so that bright edges keep their energy; history is looked up by cubic interpolation of whole pixels; the length of
// history is counted in frames, and bounded by motion.

//!include frame grid projection pack motion mirrored light_change display bindings

// `resolved` holds linear light in RGB, which may be negative, and in alpha the number of frames that are averaged in it.

// Maximum history in frames, of a pixel that moved and of one that did not. For moving pixels it is lowered for two
// reasons. Frames of several samples are already antialiased, so a long history would only blur them by interpolation.
// Light far brighter than white would leave a trail, so history is shorter if the neighbourhood deviates by more than
// white.
const LONGEST_MOVED: f32 = 10.0;
const LONGEST_STILL: f32 = 255.0;
// Maximum history of a dynamic surface in frames. Its shading changes as it turns, and it moves relative to the
// surfaces of neighbouring pixels.
const LONGEST_CARRIED: f32 = 1.0;
// Total motion, in pixels, over which the history of a slow pixel lasts: its length is LONGEST_WAY divided by the
// motion per frame, from LONGEST_MOVED to LONGEST_STILL frames. Cubic interpolation moves the finest detail by too
// little, and this lag adds up.
const LONGEST_WAY: f32 = 0.1;
// Half the width of the range to which history is clamped, in standard deviations of the neighbourhood, for static and
// for dynamic surfaces.
const ALLOWED_DEVIATIONS: f32 = 2.5;
const ALLOWED_DEVIATIONS_CARRIED: f32 = 1.0;

// Catmull-Rom weights (1974) of four adjacent pixels, for a point at a fraction `t` between the second and the third.
fn cubic(t: f32) -> vec4<f32> {
    let t2 = t * t;
    let t3 = t2 * t;
    return vec4<f32>(-0.5 * t + t2 - 0.5 * t3, 1.0 - 2.5 * t2 + 1.5 * t3, 0.5 * t + 2.0 * t2 - 1.5 * t3, 0.5 * (t3 - t2));
}

// True if one of the previous frame's four pixels around image point `seen` shows the surface `last`, in the format of
// `last_surface`. `low` and `high` are the first and the last pixel that may be read.
fn was_seen(last: vec4<u32>, seen: vec3<f32>, low: vec2<i32>, high: vec2<i32>, fovea_rows: f32) -> bool {
    let base = vec2<i32>(floor(clamp(seen.xy - 0.5, vec2<f32>(low) - 2.0, vec2<f32>(high) + 2.0)));
    let normal = unpack_normal(last.w);
    let position = point_of_last(last);
    var was = false;
    for (var i = 0; i < 4; i += 1) {
        var there = base + vec2<i32>(i & 1, i >> 1u);
        if IS_POLAR {
            let column = i32(floor(column_in(there.y, seen.x, fovea_rows) - 0.5)) + (i & 1);
            there.x = column_held(fovea_rows, there.y, column);
        }
        let is_inside = all(there >= low) && all(there <= high);
        let tap = last_guide[select(0u, u32(there.y) * pass_.width + u32(there.x), is_inside)];
        let off = abs(dot(normal, bitcast<vec3<f32>>(tap.xyz) - position));
        let is_surface = tap.w != NO_NORMAL && off < 0.01 * seen.z && dot(normal, unpack_normal(tap.w)) > 0.5;
        was = was || (is_inside && select(is_surface, tap.w == NO_NORMAL, last.w == NO_NORMAL));
    }
    return was;
}

// Vector from image point `a` to `b`. Where columns wrap around the gaze, it takes the shorter way.
fn way_between(a: vec2<f32>, b: vec2<f32>, eye: View) -> vec2<f32> {
    var way = b - a;
    if goes_around(b.y, eye.fovea_rows) {
        way.x -= f32(frame.camera.width) * round(way.x / f32(frame.camera.width));
    }
    return way;
}

// Whether a point, relative to the centre of the first pixel, is within an eye's image.
fn is_in_image(at: vec2<f32>, eye: View) -> bool {
    if IS_POLAR {
        return at.y > -0.5 && at.y < eye.rows - 0.5;
    }
    return all(at > vec2<f32>(-0.5)) && all(at < vec2<f32>(f32(pass_.width), f32(pass_.height)) - 0.5);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let now = composed[at];
    let eye = previous.views[pass_.view];

    // Statistics of the neighbourhood, and its nearest pixel: silhouettes move with the foreground.
    var mean = vec3<f32>(0.0);
    var square = vec3<f32>(0.0);
    var front = vec2<i32>(pixel);
    var depth = now.a;
    for (var dy = -1; dy <= 1; dy += 1) {
        for (var dx = -1; dx <= 1; dx += 1) {
            let held = beside(pixel, vec2<i32>(dx, dy)).pixel;
            let c = composed[pixel_index(vec2<u32>(held))];
            // Clamped, so that squares stay finite.
            let bounded = min(c.rgb, vec3<f32>(1e18));
            mean += bounded;
            square += bounded * bounded;
            let is_nearer = c.a > 0.0 && (depth <= 0.0 || c.a < depth);
            front = select(front, held, is_nearer);
            depth = select(depth, c.a, is_nearer);
        }
    }
    mean *= 1.0 / 9.0;
    let deviation = sqrt(max(square * (1.0 / 9.0) - mean * mean, vec3<f32>(0.0)));

    // Image point at which the previous frame saw the surface at `front`. The sky is at infinity.
    let at_front = point_in(vec2<f32>(front), frame.camera.centre);
    let direction = ray_of(pass_.view, vec2<f32>(front) + frame.camera.centre);
    let surface = frame.camera.views[pass_.view].origin + direction * depth;
    let stood_at = select(eye.origin + direction, surface, depth > 0.0);
    var seen = pixel_of(stood_at, eye);
    var last = vec4<u32>(0u);
    // Motion of the surface itself: 0 if static, 1 for a pixel or more.
    var carried = 0.0;
    if HAS_MOTION {
        last = last_surface[pixel_index(vec2<u32>(front))];
        let is_surface = last.w != NO_NORMAL && depth > 0.0;
        let followed = pixel_of(image_of_last(pass_.view, last), eye);
        carried = select(0.0, min(length(way_between(seen.xy, followed.xy, eye)), 1.0), is_surface);
        seen = select(seen, followed, is_surface);
    }
    // In dynamic scenes, disocclusions and shadows change static pixels too.
    let is_still = !HAS_MOTION && !has_moved(frame.camera.views[pass_.view], eye);
    let size = vec2<f32>(f32(pass_.width), f32(pass_.height));
    let motion = select(way_between(at_front, seen.xy, eye), vec2<f32>(0.0), is_still);
    var start = vec2<f32>(pixel);
    if IS_POLAR {
        start = point_in(start, frame.camera.centre) - vec2<f32>(0.0, frame.camera.centre.y);
    }
    let moved = clamp(start + motion, vec2<f32>(-2.0), size + 1.0);
    let base = floor(moved);
    let fraction = moved - base;
    let reach = i32(frame.history.rows);
    let rows = rows_around(moved.y + frame.camera.centre.y, eye.fovea_rows, eye.rows);
    let rows_low = max(max(i32(pass_.valid_begin), rows.x), i32(pixel.y) - reach);
    let rows_high = min(min(i32(pass_.valid_end), rows.y) - 1, i32(pixel.y) + reach);
    let inside = seen.z > 0.0 && is_in_image(moved, eye);
    let is_new = HAS_MOTION && !was_seen(last, seen, vec2<i32>(0, rows_low), vec2<i32>(i32(pass_.width) - 1, rows_high), eye.fovea_rows);
    let has_history = inside && !is_new && frame.history.rows != NO_HISTORY
        && i32(base.y) >= rows_low - 1 && i32(base.y) <= rows_high
        && !are_lost(i32(base.y) - 1, i32(base.y) + 3);
    var wx = cubic(fraction.x);
    let wy = cubic(fraction.y);
    var old = vec4<f32>(0.0);
    // The loop's bound skips all taps without history, since software drivers do not skip branches.
    let taps = select(0, 4, has_history);
    for (var j = 0; j < taps; j += 1) {
        let row = clamp(i32(base.y) + j - 1, rows_low, rows_high);
        var column = base.x;
        if IS_POLAR {
            let point = column_in(row, start.x + motion.x, eye.fovea_rows) - frame.camera.centre.x;
            column = floor(point);
            wx = cubic(point - column);
        }
        for (var i = 0; i < 4; i += 1) {
            var held = vec2<i32>(clamp(i32(column) + i - 1, 0, i32(pass_.width) - 1), row);
            if IS_POLAR {
                held.x = column_held(eye.fovea_rows, row, i32(column) + i - 1);
            }
            let w = wx[i] * wy[j];
            old += last_resolved[u32(held.y) * pass_.width + u32(held.x)] * w;
        }
    }
    // Stillness, from 0 (enough motion for the shortest history) to 1 (hardly any).
    let way = max(max(abs(motion.x), abs(motion.y)), LONGEST_WAY / LONGEST_STILL);
    let lasting = max(LONGEST_WAY / way - LONGEST_MOVED, 0.0) / (LONGEST_STILL - LONGEST_MOVED);
    let stillness = select(lasting, 0.0, HAS_MOTION);
    let longest_in_motion = mix(LONGEST_MOVED, LONGEST_CARRIED, carried);
    let longest_moved = longest_in_motion * inverseSqrt(mean_samples()) / (1.0 + luminance(deviation) * frame.display.storage_scale);
    let longest = select(mix(longest_moved, LONGEST_STILL, stillness), LONGEST_STILL, is_still);
    let is_known = has_history && is_finite(old.rgb) && is_finite(old.aaa);
    var frames = select(0.0, clamp(round(old.a), 0.0, min(longest, longest_in_light())), is_known);
    if HAS_MOTION && !IS_POLAR {
        frames *= kept_in_light(tile_of(pixel, stood_at), frames, 1.0);
    }

    let half = mix(ALLOWED_DEVIATIONS, ALLOWED_DEVIATIONS_CARRIED, carried) * deviation;
    // Cubic interpolation overshoots on both sides of an edge. History may be negative, since raising it to 0 would
    // brighten black surfaces beside bright ones in every frame.
    let clamped = mix(clamp(old.rgb, mean - half, mean + half), old.rgb, stillness);
    let past = select(vec3<f32>(0.0), select(clamped, old.rgb, is_still), is_known);
    let was_dropped = now.a == DROPPED;
    let total = frames + select(1.0, 0.0, was_dropped);
    let joined = mix(now.rgb, past, frames / max(total, 1e-20));
    let is_sound = is_finite(joined);
    let color = select(now.rgb, joined, is_sound);
    resolved[at] = vec4<f32>(color, total);
    linear[at] = vec4<f32>(max(color, vec3<f32>(0.0)), 1.0);
    display[at] = display_code(color);
    if was_dropped || (has_history && !is_known) || !is_sound {
        tally_image[at] = add_tally(tally_image[at], 0u, 1u);
    }
}
