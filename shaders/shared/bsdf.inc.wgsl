// Scattering at a surface. Every lobe answers the same three questions: value, density, sample.

// A direction with density cos / pi about `n` (Malley's method on the concentric disc of Shirley & Chiu 1997).
fn sample_cosine(n: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let o = 2.0 * u - 1.0;
    var r = o.x;
    var phi = 0.0;
    if abs(o.x) > abs(o.y) {
        phi = (PI / 4.0) * (o.y / o.x);
    } else if o.y != 0.0 {
        r = o.y;
        phi = (PI / 2.0) - (PI / 4.0) * (o.x / o.y);
    }
    let d = r * vec2<f32>(cos(phi), sin(phi));
    return normalize(frame_around(n) * vec3<f32>(d, sqrt(max(1.0 - r * r, 0.0))));
}

// Lambert with unit albedo: value times cosine, and density, towards `direction`. Directions below the geometric
// surface carry nothing, whatever the shading normal says.
fn diffuse_response(s: Surface, direction: vec3<f32>) -> f32 {
    let above = dot(direction, s.geometric_normal) > 0.0;
    return select(0.0, max(dot(direction, s.normal), 0.0) / PI, above);
}
