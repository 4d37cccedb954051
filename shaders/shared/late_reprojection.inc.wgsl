// Late reprojection: maps a displayed pixel of an eye that has moved since the image was rendered to the rectified
// image of the pass's eye. Each pixel searches the rendered depths for the surface that it sees, by fixed-point
// iteration (Yang et al. 2011, "Image-based bidirectional scene reprojection", section 3). Disocclusions show the light
// of adjacent surfaces. The pass binds the depths as `emission_image`.

//!include frame grid projection display_resampling bindings

const ITERATIONS: i32 = 8;

// Depth, along the eye's axis, of the surface at a point of the image; 0 for the sky.
fn depth_at(point: vec2<f32>) -> f32 {
    let size = vec2<f32>(rectified_size());
    let corner = clamp(floor(point), vec2<f32>(0.0), size - 1.0);
    let at = traced_index(corner + 0.5, size);
    let ray = pinhole_ray(pass_.view, corner + frame.camera.centre, size);
    return emission_image[at].a * dot(ray, frame.camera.views[pass_.view].forward);
}

fn later_place(at: vec2<f32>) -> ShownPlace {
    let shown = frame.camera.display_maps[pass_.view];
    let seen = shown.across * at.x + shown.down * at.y + shown.corner;
    // Start from a point at infinity.
    var place = shown_place(at);
    if all(shown.moved == vec3<f32>(0.0)) {
        return place;
    }
    for (var i = 0; i < ITERATIONS; i += 1) {
        let depth = depth_at(place.point);
        let away = (depth - shown.moved.z) / max(seen.z, 1e-20);
        if depth <= 0.0 || away <= 0.0 {
            return shown_place(at);
        }
        let there = seen * away + shown.moved;
        let scale = 1.0 / max(there.z, 1e-20);
        let point = there.xy * scale;
        place = ShownPlace(
            point,
            (shown.across.xy - point * shown.across.z) * (away * scale),
            (shown.down.xy - point * shown.down.z) * (away * scale),
        );
    }
    return place;
}
