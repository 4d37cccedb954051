// Where the rectified image of the pass's eye has what the eye shows.

struct ShownPlace {
    // Of the rectified image, pixels.
    point: vec2<f32>,
    // By how much that moves with a step of a pixel of the shown image, to the right and down.
    across: vec2<f32>,
    down: vec2<f32>,
}

// Columns and rows of the rectified image, which passes that show it have as arguments.
fn rectified_size() -> vec2<u32> {
    return vec2<u32>(pass_.args[0], pass_.args[1]);
}

// The number of the rectified image's pixel at a point of it, or of the nearest.
fn rectified_index(point: vec2<f32>) -> u32 {
    let nearest = vec2<u32>(clamp(floor(point), vec2<f32>(0.0), vec2<f32>(rectified_size()) - 1.0));
    return nearest.y * rectified_size().x + nearest.x;
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
