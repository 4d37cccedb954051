// Where a surface was seen before. Nothing but the eyes moves.

struct Previous {
    views: array<View, 2>,
}

// Whether an eye is anywhere else than it was, or looks another way.
fn has_moved(now: View, before: View) -> bool {
    return any(now.origin != before.origin) || any(now.right != before.right) || any(now.up != before.up)
        || any(now.forward != before.forward);
}

// Where an eye sees `p`: image point in pixels from the top left corner, and distance along its view direction.
fn seen_at(p: vec3<f32>, eye: View) -> vec3<f32> {
    let v = p - eye.origin;
    let z = dot(v, eye.forward);
    let front = max(z, 1e-20);
    let ndc = vec2<f32>(
        dot(v, eye.right) / (front * eye.tan_half_x),
        -dot(v, eye.up) / (front * eye.tan_half_y),
    );
    return vec3<f32>((ndc * 0.5 + 0.5) * vec2<f32>(f32(frame.camera.width), f32(frame.camera.height)), z);
}
