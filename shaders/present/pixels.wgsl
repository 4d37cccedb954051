// Draws images whose pixels lie in buffers, row after row.

struct Image {
    // Tangents of the eye's left, right, upper and lower edges.
    edges: vec4<f32>,
    width: u32,
    height: u32,
    // What is nearer along the eye's axis is as near, scene units.
    near: f32,
}

@group(0) @binding(0) var<uniform> image: Image;
// Four bytes each, red first.
@group(0) @binding(1) var<storage, read> colours: array<u32>;
// Along the rays of pixels, scene units; 0: sky.
@group(0) @binding(1) var<storage, read> distances: array<vec4<f32>>;

// A triangle that covers all.
@vertex
fn cover(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    let at = vec2<f32>(f32(corner & 1u), f32(corner >> 1u)) * 4.0 - 1.0;
    return vec4<f32>(at, 0.0, 1.0);
}

fn pixel(at: vec4<f32>) -> u32 {
    return u32(at.y) * image.width + u32(at.x);
}

@fragment
fn colour(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return unpack4x8unorm(colours[pixel(at)]);
}

// Reversed, so that the far ones keep their digits: 1 is near, and 0 infinitely far.
@fragment
fn depth(@builtin(position) at: vec4<f32>) -> @builtin(frag_depth) f32 {
    let distance = distances[pixel(at)].x;
    if !(distance > 0.0) {
        return 0.0;
    }
    let place = at.xy / vec2<f32>(f32(image.width), f32(image.height));
    let ray = mix(image.edges.xz, image.edges.yw, place);
    return min(image.near * sqrt(1.0 + dot(ray, ray)) / distance, 1.0);
}
