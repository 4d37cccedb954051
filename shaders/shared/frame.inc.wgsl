// The constants of a frame and of a pass.

@group(0) @binding(0) var<uniform> frame: Frame;
var<immediate> pass_: PassConstants;

const NO_PRIM: u32 = 0xffffffffu;
const MOST_FLOAT: f32 = 3.0e38;

// Mean samples per pixel of this frame.
fn mean_samples() -> f32 {
    return f32(frame.sampling.samples.least) + frame.sampling.samples.extra;
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}

// Power of two that scales a vector's largest component to 1 … 2. Squares of lengths overflow from 1e19 on, and squares
// of areas from 1e10; those of scaled vectors do not, and the scaling is exact.
fn power_scale(v: vec3<f32>) -> f32 {
    let most = max(max(abs(v.x), abs(v.y)), abs(v.z));
    return bitcast<f32>((254u - clamp(bitcast<u32>(most) >> 23u, 1u, 253u)) << 23u);
}

// Whether 0 < x <= most, which is false for NaN. Compares bits, since drivers may assume that there are no NaNs.
fn is_within(x: f32, most: f32) -> bool {
    return bitcast<u32>(x) - 1u < bitcast<u32>(most);
}
