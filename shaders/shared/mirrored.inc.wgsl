// Pixels that show a surface in mirrors.

// Whether perfect mirrors are replaced by the surfaces that they show (see `mirror.inc.wgsl`).
override HAS_MIRRORS: bool = false;

// Whether a pixel shows its surface in mirrors, by its `hit`. MATERIAL_NONE contains the flag.
fn is_mirrored(hit: vec4<u32>) -> bool {
    return HAS_MIRRORS && (hit.w & FLAG_MIRRORED) != 0u && (hit.w & MATERIAL_MASK) != MATERIAL_NONE;
}
