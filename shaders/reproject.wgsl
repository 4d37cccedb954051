// Spatial reprojection, right eye from left (Adelson & Hodges 1993; Leria et al.): each right pixel gathers what the
// left eye saw of its surface. The eyes are rectified, so both taps lie on the pixel's own row. What cannot be
// gathered becomes a hole.
// Where pixels are left to the filter, left ones that were not sampled give nothing, and only those that the right eye's
// own mask asks for become holes. With foveation surfaces may differ more in the outer layers.

//!include frame grid split rng pack foveation

@group(1) @binding(0) var<storage, read> left_hit: array<vec4<u32>>;
@group(1) @binding(1) var<storage, read> left_guide: array<vec4<u32>>;
@group(1) @binding(2) var<storage, read> left_radiance: array<vec4<u32>>;
@group(1) @binding(3) var<storage, read> right_hit: array<vec4<u32>>;
@group(1) @binding(4) var<storage, read> right_guide: array<vec4<u32>>;
@group(1) @binding(5) var<storage, read_write> right_radiance: array<vec4<u32>>;
@group(1) @binding(6) var<storage, read_write> right_tally: array<u32>;
@group(1) @binding(7) var<storage, read_write> holes: array<atomic<u32>>;

// Why a pixel is a hole; 0: it is none.
fn why_not(x: i32, row: u32, position: vec3<f32>, normal: vec3<f32>, material: u32, reach: f32, slack: f32) -> u32 {
    if x < 0 || x >= i32(pass_.width) {
        return OUTSIDE;
    }
    let at = row * pass_.width + u32(x);
    let hit = left_hit[at];
    if (hit.w & FLAG_MIXED) != 0u {
        return MIXED;
    }
    if (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        return VIEW;
    }
    let guide = left_guide[at];
    if (hit.w & MATERIAL_MASK) != material || guide.w == NO_NORMAL {
        return MATERIAL;
    }
    if abs(dot(normal, bitcast<vec3<f32>>(guide.xyz) - position)) >= 0.005 * slack * reach {
        return DISTANCE;
    }
    if dot(normal, unpack_normal(guide.w)) <= 1.0 - 0.01 * slack {
        return NORMAL;
    }
    if SPARSE && left_radiance[at].w == 0u {
        return SKIPPED;
    }
    return 0u;
}

// `wanted`: by the right eye's mask; else the pixel is left to the filter.
fn open_hole(at: u32, why: u32, wanted: bool) {
    if SPARSE && !wanted {
        right_tally[at] |= SKIPPED << 28u;
        return;
    }
    right_tally[at] |= why << 28u;
    let slot = atomicAdd(&holes[0], 1u);
    atomicStore(&holes[LIST_HEADER + slot], at);
    if slot % 64u == 0u && slot / 64u < 65535u {
        atomicAdd(&holes[1], 1u);
    }
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let at = pixel_index(pixel);
    let hit = right_hit[at];
    let guide = right_guide[at];
    right_radiance[at] = vec4<u32>(0u);
    var wanted = true;
    var slack = 1.0;
    var is_full = true;
    if FOVEATED {
        let layer = layer_of(pixel, 1u);
        is_full = layer == INNER;
        slack = f32(1u << layer);
    }
    if SPARSE {
        is_full = is_full && frame.sampling.sampled_share >= 1.0;
        // No filter brings light to a pixel without a surface at its centre.
        wanted = guide.w == NO_NORMAL || is_sampled(pixel, 1u);
    }
    if (hit.w & FLAG_MIXED) != 0u {
        open_hole(at, MIXED, wanted);
        return;
    }
    if guide.w == NO_NORMAL {
        return;
    }
    if (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        open_hole(at, VIEW, wanted);
        return;
    }
    let position = bitcast<vec3<f32>>(guide.xyz);
    let normal = unpack_normal(guide.w);
    let seen = pixel_of(position, frame.camera.views[0]);
    if seen.z <= 0.0 {
        open_hole(at, OUTSIDE, wanted);
        return;
    }
    let x = clamp(seen.x - frame.camera.centre.x, -2.0, f32(pass_.width) + 1.0);
    let base = floor(x);
    let fraction = x - base;
    let first = i32(base);
    let reach = length(position - frame.camera.views[0].origin);
    let material = hit.w & MATERIAL_MASK;
    let why0 = why_not(first, pixel.y, position, normal, material, reach, slack);
    let why1 = why_not(first + 1, pixel.y, position, normal, material, reach, slack);
    let w0 = select(0.0, 1.0 - fraction, why0 == 0u);
    let w1 = select(0.0, fraction, why1 == 0u);
    let sum = w0 + w1;
    if sum < 1e-4 {
        var why = select(why0, why1, why0 == 0u || (fraction > 0.5 && why1 != 0u));
        if SPARSE && (why0 == SKIPPED || why1 == SKIPPED) {
            // With its neighbours' gathers the filter has as many samples here as the mask asks for.
            wanted = is_full;
            why = OUTSIDE;
        }
        open_hole(at, why, wanted);
        return;
    }
    let row = pixel.y * pass_.width;
    let last = i32(pass_.width) - 1;
    let bits0 = left_radiance[row + u32(clamp(first, 0, last))];
    let bits1 = left_radiance[row + u32(clamp(first + 1, 0, last))];
    let tap0 = unpack_sampled(bits0);
    let tap1 = unpack_sampled(bits1);
    let matte = (tap0.matte * w0 + tap1.matte * w1) / sum;
    let gloss = (tap0.gloss * w0 + tap1.gloss * w1) / sum;
    let told = (bits0.w | select(0u, TELLS_VARIANCE, w0 == 0.0)) & (bits1.w | select(0u, TELLS_VARIANCE, w1 == 0.0));
    if (told & TELLS_VARIANCE) != 0u {
        right_radiance[at] = pack_sampled_with(matte, gloss, (tap0.a * w0 + tap1.a * w1) / sum);
        return;
    }
    right_radiance[at] = pack_sampled(matte, gloss);
}
