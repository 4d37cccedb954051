// Pixels that show a surface in mirrors or behind clear glass.

// Whether perfect mirrors and clear glass are replaced by the surfaces that they show (see `mirror.inc.wgsl`).
override HAS_MIRRORS: bool = false;

// Whether a pixel shows its surface in mirrors or behind glass, by its `hit`. MATERIAL_NONE contains the flag.
fn is_mirrored(hit: vec4<u32>) -> bool {
    return HAS_MIRRORS && (hit.w & FLAG_MIRRORED) != 0u && (hit.w & MATERIAL_MASK) != MATERIAL_NONE;
}

// World-space point at which other frames and the other eye look for a pixel's surface: its position or, in plane
// mirrors and behind panes, its image, which lies on the pixel's ray at the length of the path.
fn image_point(view: u32, pixel: vec2<u32>, hit: vec4<u32>, position: vec3<f32>) -> vec3<f32> {
    if !is_mirrored(hit) {
        return position;
    }
    let direction = ray_of(view, vec2<f32>(pixel) + frame.camera.centre);
    return frame.camera.views[view].origin + direction * bitcast<f32>(hit.y);
}
