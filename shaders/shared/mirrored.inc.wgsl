// Pixels that show a surface in mirrors or behind clear glass, and polished surfaces.

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

// Flag in the last word of the previous frame's surfaces, the lowest bit of the normal: the surface is seen in mirrors or
// behind glass. Scenes without either have one bit more of the normal.
const SEEN_MIRRORED: u32 = 1u;

// Whether a surface of the previous frame is seen in mirrors or behind glass.
fn was_mirrored(last: vec4<u32>) -> bool {
    return HAS_MIRRORS && last.w != NO_NORMAL && (last.w & SEEN_MIRRORED) != 0u;
}
