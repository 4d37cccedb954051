// Where the rectified image of the pass's eye has what the eye shows.

struct ShownPlace {
    // Of the rectified image, pixels.
    point: vec2<f32>,
    // By how much that moves with a step of a pixel of the shown image, to the right and down.
    across: vec2<f32>,
    down: vec2<f32>,
}

// For a point of the shown image.
fn shown_place(at: vec2<f32>) -> ShownPlace {
    let shown = frame.camera.shown[pass_.view];
    let seen = shown.across * at.x + shown.down * at.y + shown.corner;
    // What is shown is in front of the rectified frame.
    let scale = 1.0 / max(seen.z, 1e-20);
    let point = seen.xy * scale;
    return ShownPlace(
        point,
        (shown.across.xy - point * shown.across.z) * scale,
        (shown.down.xy - point * shown.down.z) * scale,
    );
}
