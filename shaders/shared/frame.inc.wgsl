// The constants of a frame and of a pass.

@group(0) @binding(0) var<uniform> frame: Frame;
var<immediate> pass_: PassConstants;

const NO_PRIM: u32 = 0xffffffffu;

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}
