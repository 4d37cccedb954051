// Edge-avoiding à-trous wavelet filter (Dammertz et al., HPG 2010), B3-spline taps, with the step falling from
// iteration to iteration as in Peres: 2^(i-1) ... 1. Departures: the position weight measures the distance off the
// centre's plane, relative to its distance from the eye, so that it does not depend on the scene's scale or on how
// obliquely a surface is seen; radiance is compared after c / (1 + luminance).

//!include frame pack edges

@group(1) @binding(0) var<storage, read> guide_image: array<vec4<u32>>;
@group(1) @binding(1) var<storage, read> source: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> filtered: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pixel.x >= frame.width || pixel.y >= pass_.row_end {
        return;
    }
    let at = pixel_index(pixel);
    let centre = source[at];
    let bits = guide_image[at];
    if bits.w == NO_NORMAL {
        filtered[at] = centre;
        return;
    }
    let step = i32(pass_.arg0);
    let inverse_sigma2 = bitcast<f32>(pass_.arg1);
    let guide = guide_for(bits, frame.views[pass_.view].origin, 0.02);
    let colour = comparable(centre.rgb);
    var kernel = array<f32, 5>(0.0625, 0.25, 0.375, 0.25, 0.0625);
    let low = vec2<i32>(0, i32(pass_.valid_begin));
    let high = vec2<i32>(i32(frame.width) - 1, i32(pass_.valid_end) - 1);
    // The centre always counts, so the sum of weights cannot vanish.
    var sum = centre.rgb * (0.375 * 0.375);
    var weight = 0.375 * 0.375;
    for (var dy = -2; dy <= 2; dy += 1) {
        for (var dx = -2; dx <= 2; dx += 1) {
            let there = vec2<i32>(pixel) + vec2<i32>(dx, dy) * step;
            let inside = clamp(there, low, high);
            let tap = u32(inside.y) * frame.width + u32(inside.x);
            let value = source[tap];
            let counts = all(inside == there) && (dx != 0 || dy != 0);
            let w = edge_weight(guide, colour, guide_image[tap], value.rgb, inverse_sigma2);
            let k = select(0.0, kernel[dx + 2] * kernel[dy + 2] * w, counts);
            sum += value.rgb * k;
            weight += k;
        }
    }
    filtered[at] = vec4<f32>(sum / weight, centre.a);
}
