// The scene's tables and what a hit finds there. Mirrors `accel` (triangles) and `stages::layout` (the rest).

override HAS_TEXTURES: bool = true;
override HAS_SECOND_UVS: bool = true;
override HAS_VERTEX_COLORS: bool = true;
override HAS_ALPHA: bool = true;
// Whether triangles stand anywhere else than where the tables have them.
override HAS_INSTANCES: bool = true;

// Factors of glTF's metallic-roughness material and its extensions, and the textures that multiply them.
struct Material {
    base_color: vec4<f32>,
    emissive: vec3<f32>,
    pad0: u32,
    roughness: f32,
    metallic: f32,
    alpha_cutoff: f32,
    flags: u32,
    ior: f32,
    specular: f32,
    transmission: f32,
    clearcoat: f32,
    specular_color: vec3<f32>,
    clearcoat_roughness: f32,
    // Inside a volume, per scene unit.
    absorption: vec3<f32>,
    normal_scale: f32,
    clearcoat_normal_scale: f32,
    // Its entries of `textures`; those of base colour and emission come first, in this order.
    first_texture: u32,
    texture_count: u32,
    pad: u32,
}
const DOUBLE_SIDED: u32 = 1u;
const ALPHA_MASK: u32 = 2u;
const ALPHA_BLEND: u32 = 4u;
// Encloses a volume; transmission is through a thin sheet otherwise.
const THICK: u32 = 8u;
const UNLIT: u32 = 16u;
const BASE_COLOR_TEXTURE: u32 = 32u;
const EMISSIVE_TEXTURE: u32 = 64u;
const NORMAL_MAP: u32 = 128u;
const CLEARCOAT_NORMAL_MAP: u32 = 256u;

// Vertices are exact: an edge shared by two triangles has the same bits in both.
struct Triangle {
    v0: vec3<f32>,
    material: u32,
    v1: vec3<f32>,
    flags: u32,
    v2: vec3<f32>,
    // Which of `lights` it is, if any.
    light: u32,
}
const TRIANGLE_ALPHA: u32 = 1u;

struct Shading {
    n0: vec3<f32>, u0: f32,
    n1: vec3<f32>, v0: f32,
    n2: vec3<f32>, u1: f32,
    v1: f32, u2: f32, v2: f32, pad: f32,
}

// Texels lie one after another in pages of 2048 x 2048; `first` is the index of the top left one.
struct TextureInfo {
    first: u32,
    width: u32,
    height: u32,
    flags: u32,
    // uv' = (m00 u + m01 v + tx, m10 u + m11 v + ty) as KHR_texture_transform.
    uv_matrix: vec4<f32>,
    uv_offset: vec2<f32>,
    pad: vec2<u32>,
}
const TEXTURE_LINEAR: u32 = 1u;
const TEXTURE_SECOND_UVS: u32 = 2u;
const TEXTURE_SRGB: u32 = 64u;
// What a material's texture is for, in bits 8 to 11 of the flags. Mirrors `layout::TextureRole`.
const ROLE_BASE_COLOR: u32 = 0u;
const ROLE_EMISSIVE: u32 = 1u;
const ROLE_METALLIC_ROUGHNESS: u32 = 2u;
const ROLE_NORMAL: u32 = 3u;
const ROLE_SPECULAR: u32 = 4u;
const ROLE_SPECULAR_COLOR: u32 = 5u;
const ROLE_TRANSMISSION: u32 = 6u;
const ROLE_CLEARCOAT: u32 = 7u;
const ROLE_CLEARCOAT_ROUGHNESS: u32 = 8u;
const ROLE_CLEARCOAT_NORMAL: u32 = 9u;

// Five texels per node, 1024 nodes a row. In a texture, since software drivers read texels without a loop over lanes,
// which they make for each read of a storage buffer.
@group(0) @binding(1) var nodes: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> triangles: array<Triangle>;
@group(0) @binding(3) var<storage, read> shadings: array<Shading>;
@group(0) @binding(4) var<storage, read> vertex_colors: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> materials: array<Material>;
@group(0) @binding(6) var<storage, read> textures: array<TextureInfo>;
@group(0) @binding(7) var texels: texture_2d_array<f32>;
// Three of each a triangle.
@group(0) @binding(12) var<storage, read> second_uvs: array<vec2<f32>>;
@group(0) @binding(13) var<storage, read> tangents: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> srgb_to_linear: array<f32, 256>;

fn node_part(node: u32, part: u32) -> vec4<u32> {
    return textureLoad(nodes, vec2<u32>((node & 1023u) * 5u + part, node >> 10u), 0);
}

// The same table by texels, for the trees behind that of the triangles.
fn tree_row(row: u32) -> vec4<u32> {
    return textureLoad(nodes, vec2<u32>(row % 5120u, row / 5120u), 0);
}

// A triangle where one instance of it stands. Its number in a hit is its own, several may share a row of the tables.
struct Placed {
    // In `triangles` and `shadings`; three times that where there are three of each a triangle.
    row: u32,
    // First row of its instance.
    instance: u32,
    // Whether it stands elsewhere than its row says.
    is_moved: bool,
}

// Three rows of a matrix; of instances `accel::Instance` has the order.
struct Affine {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}
const ROWS_PER_INSTANCE: u32 = 7u;
const LOCAL_FROM_WORLD: u32 = 3u;

fn affine_at(row: u32) -> Affine {
    return Affine(bitcast<vec4<f32>>(tree_row(row)), bitcast<vec4<f32>>(tree_row(row + 1u)), bitcast<vec4<f32>>(tree_row(row + 2u)));
}

fn transform_vector(m: Affine, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(m.x.xyz, v), dot(m.y.xyz, v), dot(m.z.xyz, v));
}

fn transform_point(m: Affine, p: vec3<f32>) -> vec3<f32> {
    return transform_vector(m, p) + vec3<f32>(m.x.w, m.y.w, m.z.w);
}

// First triangle's number, what leads from a number to its row, root of its tree, whether it is moved.
fn instance_header(instance: u32) -> vec4<u32> {
    return tree_row(instance + 6u);
}

fn placed(prim: u32) -> Placed {
    if !HAS_INSTANCES {
        return Placed(prim, 0u, false);
    }
    // The last instance whose numbers begin there or before.
    var low = 0u;
    var high = frame.instance_count;
    while high - low > 1u {
        let middle = (low + high) >> 1u;
        let is_before = instance_header(frame.instances + ROWS_PER_INSTANCE * middle).x <= prim;
        low = select(low, middle, is_before);
        high = select(middle, high, is_before);
    }
    let instance = frame.instances + ROWS_PER_INSTANCE * low;
    let header = instance_header(instance);
    return Placed(prim + header.y, instance, header.w != 0u);
}

// In the world.
fn triangle_at(place: Placed) -> Triangle {
    var tri = triangles[place.row];
    if HAS_INSTANCES {
        let m = affine_at(place.instance);
        tri.v0 = transform_point(m, tri.v0);
        tri.v1 = transform_point(m, tri.v1);
        tri.v2 = transform_point(m, tri.v2);
    }
    return tri;
}

// A row's unit normal in the world.
fn normal_in_world(place: Placed, n: vec3<f32>) -> vec3<f32> {
    if !HAS_INSTANCES || !place.is_moved {
        return n;
    }
    let m = affine_at(place.instance + LOCAL_FROM_WORLD);
    return normalize(m.x.xyz * n.x + m.y.xyz * n.y + m.z.xyz * n.z);
}

fn shading_at(place: Placed) -> Shading {
    var shade = shadings[place.row];
    shade.n0 = normal_in_world(place, shade.n0);
    shade.n1 = normal_in_world(place, shade.n1);
    shade.n2 = normal_in_world(place, shade.n2);
    return shade;
}

// Of a corner, 0 to 2; without length where there is none.
fn tangent_at(place: Placed, corner: u32) -> vec4<f32> {
    let t = tangents[3u * place.row + corner];
    if !HAS_INSTANCES || !place.is_moved {
        return t;
    }
    let along = transform_vector(affine_at(place.instance), t.xyz);
    let size2 = dot(along, along);
    return vec4<f32>(select(vec3<f32>(0.0), along * inverseSqrt(max(size2, 1e-30)), size2 > 1e-30), t.w);
}

// Bound of how far rounding sets a moved triangle off from where rays that start at `position` meet it: its corners are
// brought to the world (4 roundings of the terms' magnitudes), a ray's origin back to it (4, and 2 of the matrix), and
// it is intersected there. Doubled and rounded up to 16 of each.
fn placing_error(place: Placed, position: vec3<f32>) -> vec3<f32> {
    if !HAS_INSTANCES || !place.is_moved {
        return vec3<f32>(0.0);
    }
    let tri = triangles[place.row];
    let there = magnitudes(affine_at(place.instance));
    let back = transform_point(magnitudes(affine_at(place.instance + LOCAL_FROM_WORLD)), abs(position));
    let corners = transform_point(there, max(max(abs(tri.v0), abs(tri.v1)), abs(tri.v2)));
    return 16.0 * 5.9604645e-8 * (corners + transform_vector(there, back));
}

fn magnitudes(m: Affine) -> Affine {
    return Affine(abs(m.x), abs(m.y), abs(m.z));
}

fn wrap(coordinate: i32, size: i32, mode: u32) -> i32 {
    if mode == 2u {
        return clamp(coordinate, 0, size - 1);
    }
    let period = select(size, 2 * size, mode == 1u);
    var c = coordinate % period;
    c = select(c, c + period, c < 0);
    return select(c, 2 * size - 1 - c, c >= size);
}

fn texel(info: TextureInfo, x: i32, y: i32, srgb: bool) -> vec4<f32> {
    let column = wrap(x, i32(info.width), (info.flags >> 2u) & 3u);
    let row = wrap(y, i32(info.height), (info.flags >> 4u) & 3u);
    let at = info.first + u32(row) * info.width + u32(column);
    let stored = textureLoad(texels, vec2<u32>(at & 2047u, (at >> 11u) & 2047u), at >> 22u, 0);
    if !srgb {
        return stored;
    }
    let code = vec3<u32>(stored.rgb * 255.0 + 0.5);
    return vec4<f32>(srgb_to_linear[code.r], srgb_to_linear[code.g], srgb_to_linear[code.b], stored.a);
}

// Filters linear colour: the sRGB curve is undone before the texels are mixed.
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
    let s = shadings[row];
    var uv = b0 * vec2<f32>(s.u0, s.v0) + bary.x * vec2<f32>(s.u1, s.v1) + bary.y * vec2<f32>(s.u2, s.v2);
    if HAS_SECOND_UVS && (info.flags & TEXTURE_SECOND_UVS) != 0u {
        uv = b0 * second_uvs[3u * row] + bary.x * second_uvs[3u * row + 1u] + bary.y * second_uvs[3u * row + 2u];
    }
    return vec2<f32>(dot(info.uv_matrix.xy, uv), dot(info.uv_matrix.zw, uv)) + info.uv_offset;
}

fn texture_at(row: u32, bary: vec2<f32>, texture: u32) -> vec4<f32> {
    let info = textures[texture];
    return sample_texture(info, interpolate_uv(row, bary, info));
}

fn emissive_at(row: u32, bary: vec2<f32>, m: Material) -> vec3<f32> {
    if HAS_TEXTURES && (m.flags & EMISSIVE_TEXTURE) != 0u {
        let after_base = select(0u, 1u, (m.flags & BASE_COLOR_TEXTURE) != 0u);
        return m.emissive * texture_at(row, bary, m.first_texture + after_base).rgb;
    }
    return m.emissive;
}

// Without the texture.
fn base_factor_at(row: u32, bary: vec2<f32>, m: Material) -> vec4<f32> {
    if HAS_VERTEX_COLORS && 3u * row + 2u < arrayLength(&vertex_colors) {
        return m.base_color * ((1.0 - bary.x - bary.y) * vertex_colors[3u * row]
            + bary.x * vertex_colors[3u * row + 1u]
            + bary.y * vertex_colors[3u * row + 2u]);
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

// Share of rays that meet the surface there, where parts of it are cut out or thin.
fn coverage_at(row: u32, bary: vec2<f32>, m: Material) -> f32 {
    let alpha = alpha_at(row, bary, m);
    if (m.flags & ALPHA_MASK) != 0u {
        return select(0.0, 1.0, alpha >= m.alpha_cutoff);
    }
    return select(1.0, clamp(alpha, 0.0, 1.0), (m.flags & ALPHA_BLEND) != 0u);
}

// Whether a ray meets the surface there. `key` names the ray: the same ray and triangle always decide alike, in whatever
// order a traversal meets them.
fn is_covered(row: u32, prim: u32, bary: vec2<f32>, key: u32) -> bool {
    let m = materials[triangles[row].material];
    return unit_float(hash_combine(key, prim)) < coverage_at(row, bary, m);
}
