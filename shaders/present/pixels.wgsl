// Draws an eye's colours and depths from buffers, which store the pixels row by row.

struct Image {
    // Tangents of the angles from the eye's axis to the left, right, upper and lower edge of the image.
    edges: vec4<f32>,
    width: u32,
    height: u32,
    // Distance of the near plane along the eye's axis, scene units. Nearer surfaces get its depth.
    near: f32,
}

@group(0) @binding(0) var<uniform> image: Image;
// RGBA colours of the pixels, one byte per channel, red in the lowest byte.
@group(0) @binding(1) var<storage, read> colours: array<u32>;
// Distances of surfaces along the pixels' rays, scene units, in the first component; 0 for the sky.
@group(0) @binding(1) var<storage, read> distances: array<vec4<f32>>;

// Returns a corner of a triangle that covers the viewport.
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

// Returns reversed depth, which keeps the precision of far surfaces: 1 at the near plane, 0 at infinity.
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
