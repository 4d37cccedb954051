// Display encoding of linear light: exposure, c / (1 + c), sRGB.

fn display_code(color: vec3<f32>) -> u32 {
    // Clamped, so that the quotient is at most 1.
    let exposed = clamp(color, vec3<f32>(0.0), vec3<f32>(1e18)) * frame.display.exposure;
    let c = exposed / (1.0 + exposed);
    let encoded = select(1.055 * pow(max(c, vec3<f32>(1e-9)), vec3<f32>(1.0 / 2.4)) - 0.055, c * 12.92, c <= vec3<f32>(0.0031308));
    return pack4x8unorm(vec4<f32>(encoded, 1.0));
}
