// How a pixel of the pass's grid becomes a ray, and a point in the scene a pixel again: a pinhole's image.

fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * pass_.width + pixel.x;
}

// Unit direction through image point `at`, pixels from the top left corner.
fn ray_of(view: u32, at: vec2<f32>) -> vec3<f32> {
    let size = vec2<f32>(f32(pass_.width), f32(pass_.height));
    let ndc = vec2<f32>(2.0, -2.0) * (at / size) + vec2<f32>(-1.0, 1.0);
    return normalize(frame.camera.views[view].forward
        + frame.camera.views[view].right * (ndc.x * frame.camera.views[view].tan_half_x)
        + frame.camera.views[view].up * (ndc.y * frame.camera.views[view].tan_half_y));
}

// Where an eye sees `p`: image point in pixels from the top left corner, and distance along its view direction.
fn pixel_of(p: vec3<f32>, eye: View) -> vec3<f32> {
    let v = p - eye.origin;
    let z = dot(v, eye.forward);
    let front = max(z, 1e-20);
    let ndc = vec2<f32>(
        dot(v, eye.right) / (front * eye.tan_half_x),
        -dot(v, eye.up) / (front * eye.tan_half_y),
    );
    return vec3<f32>((ndc * 0.5 + 0.5) * vec2<f32>(f32(pass_.width), f32(pass_.height)), z);
}
