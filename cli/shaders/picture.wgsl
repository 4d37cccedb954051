// Draws one eye's image over the viewport, or both as an anaglyph. The images are already sRGB encoded.

@group(0) @binding(0) var eyes: texture_2d_array<f32>;
@group(0) @binding(1) var filtered: sampler;

// True if the render target applies sRGB encoding when it is written. Colours are then decoded first.
override DECODES: bool = false;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) at: vec2f,
    @location(1) @interpolate(flat) shows: u32,
}

// A triangle that covers the viewport.
@vertex
fn cover(@builtin(vertex_index) vertex: u32, @builtin(instance_index) shows: u32) -> Corner {
    let at = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return Corner(vec4f(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, 0.0, 1.0), at, shows);
}

// The inverse of the sRGB curve (IEC 61966-2-1).
fn decoded(c: vec3f) -> vec3f {
    return select(pow((c + 0.055) / 1.055, vec3f(2.4)), c / 12.92, c <= vec3f(0.04045));
}

fn shown(colour: vec3f) -> vec4f {
    if DECODES {
        return vec4f(decoded(colour), 1.0);
    }
    return vec4f(colour, 1.0);
}

fn of_eye(eye: u32, at: vec2f) -> vec3f {
    return textureSampleLevel(eyes, filtered, at, eye, 0.0).rgb;
}

@fragment
fn show(corner: Corner) -> @location(0) vec4f {
    return shown(of_eye(corner.shows, corner.at));
}

// Matches image::stereo::anaglyph: red is the left eye's luma (Rec. ITU-R BT.601), green and blue are the right eye's.
@fragment
fn show_both(corner: Corner) -> @location(0) vec4f {
    let luma = dot(of_eye(0u, corner.at), vec3f(0.299, 0.587, 0.114));
    return shown(vec3f(luma, of_eye(1u, corner.at).gb));
}
