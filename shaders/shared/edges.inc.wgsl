// Edge-stopping weights that the spatial filters share.

//!include frame pack

struct Guide {
    position: vec3<f32>,
    normal: vec3<f32>,
    // 1 / (distance from the plane at which the weight of a tap falls to 1/e).
    inverse_reach: f32,
}

fn guide_for(bits: vec4<u32>, origin: vec3<f32>, reach: f32) -> Guide {
    let position = bitcast<vec3<f32>>(bits.xyz);
    return Guide(position, unpack_normal(bits.w), 1.0 / max(reach * length(position - origin), 1e-30));
}

// Colour for comparison, compressed so that a single bright sample still blends with its neighbours.
fn comparable(c: vec3<f32>) -> vec3<f32> {
    return c / (1.0 + luminance(c));
}

// Weight of a tap. It falls with the angle between the tap's normal and the centre's, with the tap's distance from the
// centre's plane, and with `difference`, a squared difference in any other quantity.
fn surface_weight(centre: Guide, tap_bits: vec4<u32>, difference: f32) -> f32 {
    let cosine = max(dot(centre.normal, unpack_normal(tap_bits.w)), 0.0);
    let c2 = cosine * cosine;
    let c4 = c2 * c2;
    let off = dot(centre.normal, bitcast<vec3<f32>>(tap_bits.xyz) - centre.position) * centre.inverse_reach;
    // Clamped, so that the square of a weight is above 0 too.
    let w = c4 * c4 * exp(-min(off * off + difference, 40.0));
    return select(w, 0.0, tap_bits.w == NO_NORMAL);
}

// Weight of a tap by its surface and its colour. `colour` is the centre's colour, already compressed by `comparable`.
fn edge_weight(centre: Guide, colour: vec3<f32>, tap_bits: vec4<u32>, tap_colour: vec3<f32>, inverse_sigma2: f32) -> f32 {
    let d = colour - comparable(tap_colour);
    return surface_weight(centre, tap_bits, dot(d, d) * inverse_sigma2);
}
