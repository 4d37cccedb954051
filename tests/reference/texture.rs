//! Lookups in textures and in the environment.

use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

use diptych::scene::{Environment, Scene, TexelImage, TextureRef, Wrap};
use glam::{DVec2, DVec3, DVec4, Vec2};

/// Linear value of an 8-bit sRGB code (IEC 61966-2-1).
static LINEAR_FROM_SRGB: LazyLock<[f64; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let c = code as f64 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    })
});

/// Index of the texel that stands at the (unbounded) position `i` of a row of `n`.
pub fn wrap(i: f64, n: u32, mode: Wrap) -> u32 {
    let n = f64::from(n);
    let wrapped = match mode {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::MirroredRepeat => {
            let j = i.rem_euclid(2.0 * n);
            if j < n { j } else { 2.0 * n - 1.0 - j }
        }
        Wrap::ClampToEdge => i.clamp(0.0, n - 1.0),
    };
    wrapped as u32
}

fn texel(image: &TexelImage, x: u32, y: u32) -> DVec4 {
    let [r, g, b, a] = *image.get(x, y);
    let linear = |c: u8| LINEAR_FROM_SRGB[usize::from(c)];
    DVec4::new(linear(r), linear(g), linear(b), f64::from(a) / 255.0)
}

/// Linear colour and alpha of a colour texture at the mesh's own coordinates: texels are decoded, then filtered.
pub fn color(scene: &Scene, reference: TextureRef, uv: DVec2) -> DVec4 {
    let uv_from_uv = reference.uv_from_uv;
    let [x, y, origin] = [uv_from_uv.x_axis, uv_from_uv.y_axis, uv_from_uv.translation].map(|v: Vec2| v.as_dvec2());
    let uv = x * uv.x + y * uv.y + origin;
    let texture = &scene.textures[reference.texture];
    let image = &scene.images[texture.image];
    let size = image.extent;
    let at = |x: f64, y: f64| {
        let x = wrap(x, size.width, texture.wrap_u);
        texel(image, x, wrap(y, size.height, texture.wrap_v))
    };
    let place = uv * DVec2::new(size.width.into(), size.height.into());
    if texture.linear { bilinear(place, at) } else { at(place.x.floor(), place.y.floor()) }
}

/// Weighs the four texels around `place`; the centre of texel (i, j) is at (i + 0.5, j + 0.5).
fn bilinear(place: DVec2, at: impl Fn(f64, f64) -> DVec4) -> DVec4 {
    let low = (place - 0.5).floor();
    let f = place - 0.5 - low;
    let top = at(low.x, low.y).lerp(at(low.x + 1.0, low.y), f.x);
    let bottom = at(low.x, low.y + 1.0).lerp(at(low.x + 1.0, low.y + 1.0), f.x);
    top.lerp(bottom, f.y)
}

/// Radiance that arrives from infinitely far away along the unit vector `d` (which points there).
pub fn environment(environment: &Environment, d: DVec3) -> DVec3 {
    match environment {
        Environment::Black => DVec3::ZERO,
        Environment::Constant(radiance) => radiance.as_dvec3(),
        Environment::Map { image, rotation_deg } => {
            let u = 0.5 + d.x.atan2(-d.z) / TAU + f64::from(*rotation_deg) / 360.0;
            let v = d.y.clamp(-1.0, 1.0).acos() / PI;
            let size = image.extent;
            let place = DVec2::new(u * f64::from(size.width), v * f64::from(size.height));
            let at = |x: f64, y: f64| {
                let x = wrap(x, size.width, Wrap::Repeat);
                let [r, g, b] = *image.get(x, wrap(y, size.height, Wrap::ClampToEdge));
                DVec4::new(r.into(), g.into(), b.into(), 0.0)
            };
            bilinear(place, at).truncate()
        }
    }
}
