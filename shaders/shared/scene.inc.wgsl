// The scene's tables, and look-ups at a hit.

//!include frame rng tables

override HAS_TEXTURES: bool = true;
override HAS_SECOND_UVS: bool = true;
override HAS_VERTEX_COLORS: bool = true;
override HAS_ALPHA: bool = true;
override HAS_EMISSIVE: bool = true;
// Whether any triangles are instanced.
override HAS_INSTANCES: bool = true;

@group(0) @binding(2) var texels: texture_2d_array<f32>;

// An instanced triangle. Each has its own number in hits, but several may share a row of the tables.
struct Placed {
    // Index of its entry in `triangles` and `shadings`. In tables with three entries per triangle, its first entry has
    // three times this index.
    row: u32,
    // First row of its instance.
    instance: u32,
    // Whether the instance transforms it.
    is_moved: bool,
}

// The three rows of an affine transform.
struct Affine {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

fn affine_at(row: u32) -> Affine {
    return Affine(bitcast<vec4<f32>>(table_row(row)), bitcast<vec4<f32>>(table_row(row + 1u)), bitcast<vec4<f32>>(table_row(row + 2u)));
}

fn transform_vector(m: Affine, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(m.x.xyz, v), dot(m.y.xyz, v), dot(m.z.xyz, v));
}

fn transform_point(m: Affine, p: vec3<f32>) -> vec3<f32> {
    return transform_vector(m, p) + vec3<f32>(m.x.w, m.y.w, m.z.w);
}

// Header of an instance: number of its first triangle, offset from triangle numbers to table rows, index of its tree's
// root, and 1 if its triangles are transformed (else 0).
fn instance_header(instance: u32) -> vec4<u32> {
    return table_row(instance + INSTANCE_HEADER);
}

fn placed(prim: u32) -> Placed {
    if !HAS_INSTANCES {
        return Placed(prim, 0u, false);
    }
    // Find the last instance whose numbers begin at or before `prim`.
    var low = 0u;
    var high = frame.geometry.instance_count;
    while high - low > 1u {
        let middle = (low + high) >> 1u;
        let is_before = table_row(frame.geometry.instance_numbers + middle).x <= prim;
        low = select(low, middle, is_before);
        high = select(middle, high, is_before);
    }
    let instance = frame.geometry.instances + ROWS_PER_INSTANCE * table_row(frame.geometry.instance_numbers + low).y;
    let header = instance_header(instance);
    return Placed(prim + header.y, instance, header.w != 0u);
}

// World-space triangle.
fn triangle_at(place: Placed) -> Triangle {
    var tri = stored_triangle(place.row);
    if HAS_INSTANCES {
        let m = affine_at(place.instance);
        tri.v0 = transform_point(m, tri.v0);
        tri.v1 = transform_point(m, tri.v1);
        tri.v2 = transform_point(m, tri.v2);
    }
    return tri;
}

// Two edges of a triangle from its first corner, times a power of two that brings the longer one to a length of about 1.
struct Edges {
    e1: vec3<f32>,
    e2: vec3<f32>,
    scale: f32,
}

fn scaled_edges(tri: Triangle) -> Edges {
    let e1 = tri.v1 - tri.v0;
    let e2 = tri.v2 - tri.v0;
    let scale = power_scale(max(abs(e1), abs(e2)));
    return Edges(e1 * scale, e2 * scale, scale);
}

// Transforms a stored unit normal to world space.
fn normal_in_world(place: Placed, n: vec3<f32>) -> vec3<f32> {
    if !HAS_INSTANCES || !place.is_moved {
        return n;
    }
    let m = affine_at(place.instance + LOCAL_FROM_WORLD);
    return normalize(m.x.xyz * n.x + m.y.xyz * n.y + m.z.xyz * n.z);
}

fn shading_at(place: Placed) -> Shading {
    var shade = stored_shading(place.row);
    shade.n0 = normal_in_world(place, shade.n0);
    shade.n1 = normal_in_world(place, shade.n1);
    shade.n2 = normal_in_world(place, shade.n2);
    return shade;
}

// Tangent at a corner (0 to 2) of a triangle; zero if there is none.
fn tangent_at(place: Placed, corner: u32) -> vec4<f32> {
    if frame.tables.tangents == 0u {
        return vec4<f32>(0.0);
    }
    let t = bitcast<vec4<f32>>(table_row(frame.tables.tangents + 3u * place.row + corner));
    if !HAS_INSTANCES || !place.is_moved {
        return t;
    }
    let along = transform_vector(affine_at(place.instance), t.xyz);
    let size2 = dot(along, along);
    return vec4<f32>(select(vec3<f32>(0.0), along * inverseSqrt(max(size2, 1e-30)), size2 > 1e-30), t.w);
}

// Bound of the rounding error between a transformed triangle and the hits of rays that start at `position`. The
// triangle's corners are transformed to world space (4 roundings of the terms' magnitudes). A ray's origin is
// transformed to local space, where it is intersected (4 roundings, and 2 of the matrix). The bound counts 16 roundings
// for each of the two transforms, which is more than twice as many.
fn placing_error(place: Placed, position: vec3<f32>) -> vec3<f32> {
    if !HAS_INSTANCES || !place.is_moved {
        return vec3<f32>(0.0);
    }
    let tri = stored_triangle(place.row);
    let there = magnitudes(affine_at(place.instance));
    let back = transform_point(magnitudes(affine_at(place.instance + LOCAL_FROM_WORLD)), abs(position));
    let corners = transform_point(there, max(max(abs(tri.v0), abs(tri.v1)), abs(tri.v2)));
    return 16.0 * 5.9604645e-8 * (corners + transform_vector(there, back));
}

fn magnitudes(m: Affine) -> Affine {
    return Affine(abs(m.x), abs(m.y), abs(m.z));
}

fn wrap(coordinate: i32, size: i32, mode: u32) -> i32 {
    if mode == WRAP_CLAMP {
        return clamp(coordinate, 0, size - 1);
    }
    let period = select(size, 2 * size, mode == WRAP_MIRROR);
    var c = coordinate % period;
    c = select(c, c + period, c < 0);
    return select(c, 2 * size - 1 - c, c >= size);
}

fn linear_from_srgb(code: u32) -> f32 {
    return bitcast<f32>(table_row(frame.tables.srgb + code).x);
}

fn texel(info: TextureInfo, x: i32, y: i32, srgb: bool) -> vec4<f32> {
    let column = wrap(x, i32(info.width), (info.flags >> WRAP_U_SHIFT) & 3u);
    let row = wrap(y, i32(info.height), (info.flags >> WRAP_V_SHIFT) & 3u);
    let at = info.first + u32(row) * info.width + u32(column);
    let stored = textureLoad(texels, vec2<u32>(at % PAGE, (at / PAGE) % PAGE), at / (PAGE * PAGE), 0);
    if !srgb {
        return stored;
    }
    let code = vec3<u32>(stored.rgb * 255.0 + 0.5);
    return vec4<f32>(linear_from_srgb(code.r), linear_from_srgb(code.g), linear_from_srgb(code.b), stored.a);
}

// Filters linear colour: sRGB is decoded before texels are mixed.
fn sample_texture(info: TextureInfo, uv: vec2<f32>) -> vec4<f32> {
    let srgb = (info.flags & TEXTURE_SRGB) != 0u;
    let size = vec2<f32>(f32(info.width), f32(info.height));
    // Far-off coordinates lose their fraction anyway; bounding them keeps the integer conversion defined.
    let at = clamp(uv * size, vec2<f32>(-1e9), vec2<f32>(1e9));
    if (info.flags & TEXTURE_LINEAR) == 0u {
        let nearest = vec2<i32>(floor(at));
        return texel(info, nearest.x, nearest.y, srgb);
    }
    let base = floor(at - 0.5);
    let f = at - 0.5 - base;
    let b = vec2<i32>(base);
    let top = mix(texel(info, b.x, b.y, srgb), texel(info, b.x + 1, b.y, srgb), f.x);
    let bottom = mix(texel(info, b.x, b.y + 1, srgb), texel(info, b.x + 1, b.y + 1, srgb), f.x);
    return mix(top, bottom, f.y);
}

fn interpolate_uv(row: u32, bary: vec2<f32>, info: TextureInfo) -> vec2<f32> {
    let b0 = 1.0 - bary.x - bary.y;
    let s = stored_shading(row);
    var uv = b0 * vec2<f32>(s.u0, s.v0) + bary.x * vec2<f32>(s.u1, s.v1) + bary.y * vec2<f32>(s.u2, s.v2);
    if HAS_SECOND_UVS && (info.flags & TEXTURE_SECOND_UVS) != 0u {
        let second = stored_second_uvs(row);
        uv = select(vec2<f32>(0.0), b0 * second.uv0 + bary.x * second.uv1 + bary.y * second.uv2, frame.tables.second_uvs > 0u);
    }
    return vec2<f32>(dot(info.uv_matrix.xy, uv), dot(info.uv_matrix.zw, uv)) + info.uv_offset;
}

fn texture_at(row: u32, bary: vec2<f32>, texture: u32) -> vec4<f32> {
    let info = stored_texture(texture);
    return sample_texture(info, interpolate_uv(row, bary, info));
}

fn emissive_at(row: u32, bary: vec2<f32>, m: Material) -> vec3<f32> {
    if HAS_TEXTURES && (m.flags & EMISSIVE_TEXTURE) != 0u {
        let after_base = select(0u, 1u, (m.flags & BASE_COLOR_TEXTURE) != 0u);
        return m.emissive * texture_at(row, bary, m.first_texture + after_base).rgb;
    }
    return m.emissive;
}

fn vertex_color(corner: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(table_row(frame.tables.vertex_colors + corner));
}

// Base colour without the texture.
fn base_factor_at(row: u32, bary: vec2<f32>, m: Material) -> vec4<f32> {
    if HAS_VERTEX_COLORS && frame.tables.vertex_colors > 0u {
        return m.base_color * ((1.0 - bary.x - bary.y) * vertex_color(3u * row)
            + bary.x * vertex_color(3u * row + 1u)
            + bary.y * vertex_color(3u * row + 2u));
    }
    return m.base_color;
}

fn alpha_at(row: u32, bary: vec2<f32>, m: Material) -> f32 {
    let factor = base_factor_at(row, bary, m).a;
    if HAS_TEXTURES && (m.flags & BASE_COLOR_TEXTURE) != 0u {
        return factor * texture_at(row, bary, m.first_texture).a;
    }
    return factor;
}

// Fraction of rays that hit the surface at barycentrics `bary`, given its alpha there.
fn coverage_at(row: u32, bary: vec2<f32>, m: Material) -> f32 {
    let alpha = alpha_at(row, bary, m);
    if (m.flags & ALPHA_MASK) != 0u {
        return select(0.0, 1.0, alpha >= m.alpha_cutoff);
    }
    return select(1.0, clamp(alpha, 0.0, 1.0), (m.flags & ALPHA_BLEND) != 0u);
}

// Whether a ray hits the surface at barycentrics `bary`. `key` identifies the ray: for the same ray and triangle, the
// result is always the same, in any order of traversal.
fn is_covered(row: u32, prim: u32, bary: vec2<f32>, key: u32) -> bool {
    let m = stored_material(stored_triangle(row).material);
    return unit_float(hash_combine(key, prim)) < coverage_at(row, bary, m);
}
