// Mathematics that does not depend on the scene.

const PI: f32 = 3.14159265358979;

fn max3(c: vec3<f32>) -> f32 {
    return max(max(c.r, c.g), c.b);
}

fn frame_around(n: vec3<f32>) -> mat3x3<f32> {
    // Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3<f32>(
        vec3<f32>(1.0 + s * n.x * n.x * a, s * b, -s * n.x),
        vec3<f32>(b, s + n.y * n.y * a, -n.y),
        n,
    );
}
