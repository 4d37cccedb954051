// Spatial reprojection, right eye from left (Adelson & Hodges 1993; Leria et al.): each right pixel gathers the light
// that the left eye saw on its surface. The eyes are rectified, so both taps lie on the pixel's own row. Polar images
// use four taps, at most `args[0]` rows away. A pixel without any valid tap becomes a hole. If a sampling mask leaves
// pixels to the filter, left pixels that were not sampled are invalid taps, and only right pixels in the right eye's
// own mask become holes. With foveation, taps may differ more from the surface in the outer layers. Surfaces in plane
// mirrors are looked up at their image, which lies on the same row in both eyes; other mirrors give holes.

//!include frame grid projection split rng pack mirrored foveation bindings

// Whether pixels that show several surfaces take over light, for a filter that blends light at edges anyway. Their mean
// albedo is that of all surfaces.
override ACCEPTS_MIXED: bool = false;

// Surface of a right pixel, as the left eye is searched for it.
struct Wanted {
    position: vec3<f32>,
    normal: vec3<f32>,
    // Position or, in mirrors, the image point.
    image: vec3<f32>,
    // Distance of the image from the left eye.
    reach: f32,
    material: u32,
    // Factor by which taps may differ more than in the innermost layer.
    slack: f32,
}

// Relative difference, and difference over `reach`, of two distances that count as equal.
const SAME_RATIO: f32 = 0.05;
const SAME_DISTANCE: f32 = 0.0005;

// Whether a mirrored surface of the left eye is as far from the wanted one as their images are from one another. This
// holds for plane mirrors, which keep distances. Curved mirrors scale them, and show the surface elsewhere.
fn keeps_distance(at: u32, hit: vec4<u32>, position: vec3<f32>, wanted: Wanted) -> bool {
    let pixel = vec2<u32>(at % pass_.width, at / pass_.width);
    let apart = length(image_point(0u, pixel, hit, position) - wanted.image);
    let off = abs(length(position - wanted.position) - apart);
    return off <= wanted.slack * (SAME_RATIO * apart + SAME_DISTANCE * wanted.reach);
}

// Returns the reason that a left pixel is not a valid tap; 0 if it is valid.
fn why_not(at: u32, wanted: Wanted) -> u32 {
    let hit = left_hit[at];
    if !ACCEPTS_MIXED && (hit.w & FLAG_MIXED) != 0u {
        return MIXED;
    }
    if (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        return VIEW;
    }
    let guide = left_guide[at];
    if (hit.w & MATERIAL_MASK) != wanted.material || guide.w == NO_NORMAL {
        return MATERIAL;
    }
    let position = bitcast<vec3<f32>>(guide.xyz);
    if abs(dot(wanted.normal, position - wanted.position)) >= 0.005 * wanted.slack * wanted.reach {
        return DISTANCE;
    }
    if dot(wanted.normal, unpack_normal(guide.w)) <= 1.0 - 0.01 * wanted.slack {
        return NORMAL;
    }
    if is_mirrored(hit) && !keeps_distance(at, hit, position, wanted) {
        return VIEW;
    }
    if SPARSE && left_radiance[at].w == 0u {
        return SKIPPED;
    }
    return 0u;
}

// A pixel of the left image around a point, with its linear weight.
struct Tap {
    at: u32,
    weight: f32,
    is_there: bool,
}

// The `i`th tap around image point `seen` of the left eye, for a pixel in row `row` of the right eye.
fn tap_around(seen: vec2<f32>, row: u32, i: i32) -> Tap {
    if IS_POLAR {
        let eye = frame.camera.views[0];
        let y = clamp(seen.y - frame.camera.centre.y, -2.0, eye.rows + 1.0);
        let there = i32(floor(y)) + (i >> 1u);
        let rows = rows_around(seen.y, eye.fovea_rows, eye.rows);
        let low = max(max(i32(pass_.valid_begin), rows.x), i32(row) - i32(pass_.args[0]));
        let high = min(min(i32(pass_.valid_end), rows.y), i32(row) + i32(pass_.args[0]) + 1);
        let x = column_in(there, seen.x, eye.fovea_rows) - frame.camera.centre.x;
        let column = column_held(eye.fovea_rows, there, i32(floor(x)) + (i & 1));
        let near = abs(vec2<f32>(f32(1 - (i & 1)), f32(1 - (i >> 1u))) - fract(vec2<f32>(x, y)));
        let is_there = there >= low && there < high;
        return Tap(select(0u, u32(there) * pass_.width + u32(column), is_there), near.x * near.y, is_there);
    }
    let x = clamp(seen.x - frame.camera.centre.x, -2.0, f32(pass_.width) + 1.0);
    let there = i32(floor(x)) + i;
    let is_there = there >= 0 && there < i32(pass_.width);
    let at = row * pass_.width + u32(clamp(there, 0, i32(pass_.width) - 1));
    return Tap(at, select(fract(x), 1.0 - fract(x), i == 0), is_there);
}

// Lists a hole if the right eye's sampling mask contains it (`wanted`), and otherwise leaves it to the filter.
fn open_hole(at: u32, why: u32, wanted: bool) {
    if SPARSE && !wanted {
        tally_image[at] |= SKIPPED << 28u;
        return;
    }
    tally_image[at] |= why << 28u;
    let slot = atomicAdd(&holes[0], 1u);
    atomicStore(&holes[LIST_HEADER + slot], at);
    if slot % 64u == 0u && slot / 64u < 65535u {
        atomicAdd(&holes[1], 1u);
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let hit = hit_image[at];
    let guide = guide_image[at];
    radiance_image[at] = vec4<u32>(0u);
    var is_wanted = true;
    var slack = 1.0;
    var is_full = true;
    if FOVEATED {
        let layer = layer_of(pixel, 1u);
        is_full = layer == INNER;
        slack = f32(1u << layer);
    }
    if SPARSE {
        is_full = is_full && frame.sampling.sampled_fraction >= 1.0;
        // Filters do not fill a pixel without a surface at its centre.
        is_wanted = guide.w == NO_NORMAL || is_sampled(pixel, 1u);
    }
    if (hit.w & FLAG_MIXED) != 0u && (!ACCEPTS_MIXED || guide.w == NO_NORMAL) {
        open_hole(at, MIXED, is_wanted);
        return;
    }
    if guide.w == NO_NORMAL {
        return;
    }
    if (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        open_hole(at, VIEW, is_wanted);
        return;
    }
    let position = bitcast<vec3<f32>>(guide.xyz);
    let image = image_point(1u, pixel, hit, position);
    let seen = pixel_of(image, frame.camera.views[0]);
    if seen.z <= 0.0 {
        open_hole(at, OUTSIDE, is_wanted);
        return;
    }
    let reach = length(image - frame.camera.views[0].origin);
    let wanted = Wanted(position, unpack_normal(guide.w), image, reach, hit.w & MATERIAL_MASK, slack);
    var sum = 0.0;
    var matte = vec3<f32>(0.0);
    var gloss = vec3<f32>(0.0);
    var variance = vec2<f32>(0.0);
    var told = TELLS_VARIANCE;
    var why = OUTSIDE;
    var missed = -1.0;
    var was_skipped = false;
    for (var i = 0; i < select(2, 4, IS_POLAR); i += 1) {
        let tap = tap_around(seen.xy, pixel.y, i);
        var why_tap = OUTSIDE;
        if tap.is_there {
            why_tap = why_not(tap.at, wanted);
        }
        was_skipped = was_skipped || why_tap == SKIPPED;
        if why_tap != 0u {
            // The reason is that of the invalid tap with the largest weight.
            why = select(why, why_tap, tap.weight > missed);
            missed = max(missed, tap.weight);
        } else if tap.weight > 0.0 {
            let bits = left_radiance[tap.at];
            let light = unpack_sampled(bits);
            matte += light.matte * tap.weight;
            gloss += light.gloss * tap.weight;
            variance += light.a * tap.weight;
            sum += tap.weight;
            told &= bits.w;
        }
    }
    if sum < 1e-4 {
        if SPARSE && was_skipped {
            // The left eye's mask skips the surface. Unless the right eye's mask samples all pixels here, leave the
            // pixel to the filter: neighbouring pixels gather samples of the left eye, so the area around this pixel
            // has as many samples as intended.
            is_wanted = is_full;
            why = OUTSIDE;
        }
        open_hole(at, why, is_wanted);
        return;
    }
    if told != 0u {
        radiance_image[at] = pack_sampled_with(matte / sum, gloss / sum, variance / sum);
        return;
    }
    radiance_image[at] = pack_sampled(matte / sum, gloss / sum);
}
