// The constants of a frame and of a pass, and the pinhole rig.

@group(0) @binding(0) var<uniform> frame: Frame;
var<immediate> pass_: PassConstants;

const NO_PRIM: u32 = 0xffffffffu;

fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * frame.camera.width + pixel.x;
}

// Unit direction through image point `at`, pixels from the top left corner.
fn ray_direction(view: u32, at: vec2<f32>) -> vec3<f32> {
    let size = vec2<f32>(f32(frame.camera.width), f32(frame.camera.height));
    let ndc = vec2<f32>(2.0, -2.0) * (at / size) + vec2<f32>(-1.0, 1.0);
    return normalize(frame.camera.views[view].forward
        + frame.camera.views[view].right * (ndc.x * frame.camera.views[view].tan_half_x)
        + frame.camera.views[view].up * (ndc.y * frame.camera.views[view].tan_half_y));
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}
