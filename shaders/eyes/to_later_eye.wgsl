// Resamples a rectified image to what an eye shows that has moved on since: each pixel looks for the surface that it sees among
// those that were seen, by fixed-point iteration over their depths (Yang et al. 2011, "Image-based bidirectional scene
// reprojection", section 3). What was hidden then has the light of what is next to it.

//!include frame grid display shown resampled

@group(1) @binding(0) var<storage, read> rectified: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> linear: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> display: array<u32>;

@group(1) @binding(3) var<storage, read> emission_image: array<vec4<f32>>;

const ITERATIONS: i32 = 8;

// How far along the eye's axis the surface is that the image shows at a point of it; 0: the sky.
fn depth_at(point: vec2<f32>) -> f32 {
    let size = vec2<f32>(f32(frame.camera.width), f32(frame.camera.height));
    let at = vec2<u32>(clamp(floor(point), vec2<f32>(0.0), size - 1.0));
    let distance = emission_image[at.y * frame.camera.width + at.x].a;
    let ray = pinhole_ray(pass_.view, vec2<f32>(at) + frame.camera.centre, size);
    return distance * dot(ray, frame.camera.views[pass_.view].forward);
}

fn later_place(at: vec2<f32>) -> ShownPlace {
    let shown = frame.camera.shown[pass_.view];
    let seen = shown.across * at.x + shown.down * at.y + shown.corner;
    // The point that is endlessly far.
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

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    // Of what is shown.
    if pixel.x >= pass_.width || pixel.y >= pass_.row_end {
        return;
    }
    let color = resampled(later_place(vec2<f32>(pixel) + 0.5));
    let at = pixel.y * pass_.width + pixel.x;
    linear[at] = vec4<f32>(color, 1.0);
    display[at] = display_code(color);
}
