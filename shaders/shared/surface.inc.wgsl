// What a ray finds where it hits a triangle.

struct Surface {
    position: vec3<f32>,
    // Bound of the position's rounding error along the geometric normal.
    error: f32,
    // Both face the side the ray came from.
    geometric_normal: vec3<f32>,
    normal: vec3<f32>,
    albedo: vec3<f32>,
    roughness: f32,
    emission: vec3<f32>,
    material: u32,
}

fn surface_at(prim: u32, bary: vec2<f32>, direction: vec3<f32>) -> Surface {
    let tri = triangles[prim];
    let shade = shadings[prim];
    let m = materials[tri.material];
    let b0 = 1.0 - bary.x - bary.y;
    var s: Surface;
    s.position = b0 * tri.v0 + bary.x * tri.v1 + bary.y * tri.v2;
    var ng = cross(tri.v1 - tri.v0, tri.v2 - tri.v0);
    let size = length(ng);
    ng = select(-direction, ng / size, size > 0.0);
    var ns = b0 * shade.n0 + bary.x * shade.n1 + bary.y * shade.n2;
    let ns_size = length(ns);
    ns = select(ng, ns / ns_size, ns_size > 1e-12);
    let front = dot(ng, direction) <= 0.0;
    s.geometric_normal = select(-ng, ng, front);
    ns = select(-ns, ns, front);
    s.normal = select(s.geometric_normal, ns, dot(ns, direction) < 0.0);
    // Interpolation costs 7 roundings of the terms' magnitudes (Pharr et al., PBRT 4e, 6.8.5); doubled, since the
    // triangle that a ray must not meet again is intersected in f32 too.
    let magnitude = abs(b0 * tri.v0) + abs(bary.x * tri.v1) + abs(bary.y * tri.v2);
    s.error = 2.0 * 7.0 * 5.9604645e-8 * dot(abs(ng), magnitude);
    s.albedo = base_color_at(prim, bary, m).rgb;
    s.roughness = m.roughness;
    s.material = tri.material;
    s.emission = vec3<f32>(0.0);
    if HAS_EMISSIVE {
        if front || (m.flags & DOUBLE_SIDED) != 0u {
            s.emission = emissive_at(prim, bary, m);
        }
    }
    return s;
}

// Where a ray that leaves the surface towards `direction` starts: off the surface by the error bound, then rounded away.
fn leave(s: Surface, direction: vec3<f32>) -> vec3<f32> {
    let n = select(-s.geometric_normal, s.geometric_normal, dot(direction, s.geometric_normal) >= 0.0);
    let moved = s.position + n * s.error;
    let ulp = max(abs(moved) * 1.1920929e-7, vec3<f32>(1e-30));
    return moved + sign(n) * ulp;
}
