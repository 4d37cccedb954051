// Display resampling: maps a displayed pixel to the rectified image of the pass's eye.

//!include frame

struct ShownPlace {
    // Position in the rectified image, pixels.
    point: vec2<f32>,
    // Derivatives of that position, per displayed pixel to the right and down.
    across: vec2<f32>,
    down: vec2<f32>,
}

// Size of the rectified image, from the pass's arguments.
fn rectified_size() -> vec2<u32> {
    return vec2<u32>(pass_.args.width, pass_.args.height);
}

// Index of the rectified pixel at a point, or of the nearest one.
fn rectified_index(point: vec2<f32>) -> u32 {
    let nearest = vec2<u32>(clamp(floor(point), vec2<f32>(0.0), vec2<f32>(rectified_size()) - 1.0));
    return nearest.y * rectified_size().x + nearest.x;
}

// Maps a point of the displayed image to the rectified image.
fn shown_place(at: vec2<f32>) -> ShownPlace {
    let shown = frame.camera.display_maps[pass_.view];
    let seen = shown.across * at.x + shown.down * at.y + shown.corner;
    // The clamp only guards the division: all displayed points are in front of the rectified view.
    let scale = 1.0 / max(seen.z, 1e-20);
    let point = seen.xy * scale;
    return ShownPlace(
        point,
        (shown.across.xy - point * shown.across.z) * scale,
        (shown.down.xy - point * shown.down.z) * scale,
    );
}
