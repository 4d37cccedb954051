// Packing of pixels for later stages.

// `hit` image. Word x: triangle, NO_PRIM, or SPHERE | light. Words y and z: barycentrics, as floats; if FLAG_MIRRORED is
// set, word y is the distance of the surface's image in the mirrors and glass from the eye, and word z holds both
// barycentrics and whether the mirrors have moved. Word w: material and flags.
const FLAG_MIXED: u32 = 0x80000000u;
const FLAG_VIEW_DEPENDENT: u32 = 0x40000000u;
// Set for a surface seen in perfect mirrors or through clear glass. It is part of the material, so that history never
// mixes a surface with its mirror image.
const FLAG_MIRRORED: u32 = 0x00800000u;
const MATERIAL_MASK: u32 = 0x00ffffffu;
// Roughness, if the scene has gloss.
const ROUGHNESS_SHIFT: u32 = 24u;
const ROUGHNESS_STEPS: f32 = 63.0;
const MATERIAL_NONE: u32 = 0x00ffffffu;

// `guide` image: position as bits, packed shading normal; NO_NORMAL if there is no surface to shade (sky, spheres).
// Packing never produces this pattern, since it clamps to -32767.
const NO_NORMAL: u32 = 0x80008000u;

// Maps a unit vector to a square from -1 to 1, and back (Cigolle et al., "A Survey of Efficient Representations for
// Independent Unit Vectors", JCGT 3(2), 2014).
fn unfolded(n: vec3<f32>) -> vec2<f32> {
    let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let signs = select(vec2<f32>(-1.0), vec2<f32>(1.0), p >= vec2<f32>(0.0));
    return select(p, (1.0 - abs(p.yx)) * signs, n.z < 0.0);
}

fn folded(p: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(p.x) - abs(p.y);
    let t = max(-z, 0.0);
    return normalize(vec3<f32>(p + select(vec2<f32>(t), vec2<f32>(-t), p >= vec2<f32>(0.0)), z));
}

// Packs a unit vector into two 16-bit numbers.
fn pack_normal(n: vec3<f32>) -> u32 {
    return pack2x16snorm(unfolded(n));
}

fn unpack_normal(bits: u32) -> vec3<f32> {
    return folded(unpack2x16snorm(bits));
}

// `tally` image: number of rays traced (20 bits); number of samples, and of values of later stages, that were dropped
// (8 bits); hole reason (3 bits; SKIPPED marks a pixel that is left to the denoiser, which is not a hole). The last bit,
// CLIPPED, marks light that was too bright for half floats.
const CLIPPED: u32 = 0x80000000u;

const REASON_BITS: u32 = 0x70000000u;

fn hole_reason(tally: u32) -> u32 {
    return (tally & ~CLIPPED) >> 28u;
}

fn add_tally(tally: u32, rays: u32, nonfinite: u32) -> u32 {
    let r = min((tally & 0xfffffu) + rays, 0xfffffu);
    let n = min(((tally >> 20u) & 0xffu) + nonfinite, 0xffu);
    return (tally & 0xf0000000u) | (n << 20u) | r;
}

// Depth of a composed pixel whose colour was not finite. Temporal antialiasing counts such pixels.
const DROPPED: f32 = -1.0;

// Tests bits, since drivers may assume that all values are finite.
fn is_finite(c: vec3<f32>) -> bool {
    let bits = bitcast<vec3<u32>>(c) & vec3<u32>(0x7f800000u);
    return all(bits != vec3<u32>(0x7f800000u));
}
