// Pixels that show a surface in mirrors or behind clear glass, and polished surfaces.

//!include frame projection pack

// Whether perfect mirrors and clear glass are replaced by the surfaces that they show (see `mirror.inc.wgsl`).
override HAS_MIRRORS: bool = false;

// Whether the reflections of polished surfaces are followed (see `mirror.inc.wgsl`).
override HAS_POLISH: bool = false;

// Whether a pixel shows its surface in mirrors or behind glass, by its `hit`. MATERIAL_NONE contains the flag.
fn is_mirrored(hit: vec4<u32>) -> bool {
    return HAS_MIRRORS && (hit.w & FLAG_MIRRORED) != 0u && (hit.w & MATERIAL_MASK) != MATERIAL_NONE;
}

// World-space point at which other frames and the other eye look for a pixel's surface: its position or, in mirrors and
// behind glass, its image, which lies on the pixel's ray.
fn image_point(view: u32, pixel: vec2<u32>, hit: vec4<u32>, position: vec3<f32>) -> vec3<f32> {
    if !is_mirrored(hit) {
        return position;
    }
    let direction = ray_of(view, vec2<f32>(pixel) + frame.camera.centre);
    return frame.camera.views[view].origin + direction * bitcast<f32>(hit.y);
}

// Packs barycentrics, and whether a mirror or glass before the surface has moved since the previous frame.
fn pack_mirrored(bary: vec2<f32>, has_moved: bool) -> u32 {
    return (pack2x16unorm(bary) & ~1u) | select(0u, 1u, has_moved);
}

fn mirrored_bary(hit: vec4<u32>) -> vec2<f32> {
    return unpack2x16unorm(hit.z & ~1u);
}

fn have_mirrors_moved(hit: vec4<u32>) -> bool {
    return (hit.z & 1u) != 0u;
}

// In dynamic scenes, the previous frame's surface of a pixel that shows it in mirrors or behind glass. Word x: the
// distance of the surface's plane from the world's origin, as a float. Words y and z: the point at which the previous
// frame saw its image. Word w: its normal, whose lowest bit is SEEN_MIRRORED. Scenes without mirrors have one bit more of
// the normal.
const SEEN_MIRRORED: u32 = 1u;

// Whether a surface of the previous frame is seen in mirrors or behind glass.
fn was_mirrored(last: vec4<u32>) -> bool {
    return HAS_MIRRORS && last.w != NO_NORMAL && (last.w & SEEN_MIRRORED) != 0u;
}

// Steps from -1 to 1 of each coordinate of a packed direction, a 21-bit number.
const DIRECTION_STEPS: f32 = 2097151.0;

// Packs a vector: its direction in 42 bits, the first of which are y's, and its length in 22 bits.
fn pack_away(away: vec3<f32>) -> vec2<u32> {
    let distance = length(away);
    let place = 0.5 + 0.5 * unfolded(away / max(distance, 1e-37));
    let steps = vec2<u32>(round(clamp(place, vec2<f32>(0.0), vec2<f32>(1.0)) * DIRECTION_STEPS));
    return vec2<u32>(steps.x | (steps.y << 21u), (steps.y >> 11u) | (bitcast<u32>(distance) & 0xfffffc00u));
}

fn unpack_away(bits: vec2<u32>) -> vec3<f32> {
    let steps = vec2<u32>(bits.x & 0x1fffffu, (bits.x >> 21u) | ((bits.y & 0x3ffu) << 11u));
    return folded(2.0 * (vec2<f32>(steps) / DIRECTION_STEPS) - 1.0) * bitcast<f32>(bits.y & 0xfffffc00u);
}

fn pack_mirrored_last(view: u32, position: vec3<f32>, normal: vec3<f32>, image: vec3<f32>) -> vec4<u32> {
    let bits = (pack_normal(normal) & ~SEEN_MIRRORED) | SEEN_MIRRORED;
    let plane = dot(unpack_normal(bits), position);
    return vec4<u32>(bitcast<u32>(plane), pack_away(image - frame.camera.views[view].origin), bits);
}

// A point on the plane of a previous frame's surface: where it was or, in mirrors, the point of the plane that is nearest
// to the world's origin.
fn point_of_last(last: vec4<u32>) -> vec3<f32> {
    return select(bitcast<vec3<f32>>(last.xyz), unpack_normal(last.w) * bitcast<f32>(last.x), was_mirrored(last));
}

// Where the previous frame saw its surface.
fn image_of_last(view: u32, last: vec4<u32>) -> vec3<f32> {
    return select(bitcast<vec3<f32>>(last.xyz), frame.camera.views[view].origin + unpack_away(last.yz), was_mirrored(last));
}
