//! Texture lookups.

use std::sync::LazyLock;

use diptych::scene::{Scene, TexelImage, TextureRef, Wrap};
use glam::{DVec2, DVec4, Vec2};

/// Linear values of 8-bit sRGB codes (IEC 61966-2-1).
static LINEAR_FROM_SRGB: LazyLock<[f64; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let c = code as f64 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    })
});

/// Returns the index of the texel at the (unbounded) position `i` of a row of `n`.
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

/// Encoding of red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Srgb,
    Linear,
}

fn texel(image: &TexelImage, x: u32, y: u32, encoding: Encoding) -> DVec4 {
    let [r, g, b, a] = *image.get(x, y);
    let share = |c: u8| f64::from(c) / 255.0;
    let decoded = |c: u8| match encoding {
        Encoding::Srgb => LINEAR_FROM_SRGB[usize::from(c)],
        Encoding::Linear => share(c),
    };
    DVec4::new(decoded(r), decoded(g), decoded(b), share(a))
}

/// Returns linear values of a texture at the mesh's own coordinates: texels are decoded, then filtered.
pub fn look_up(scene: &Scene, reference: TextureRef, uv: DVec2, encoding: Encoding) -> DVec4 {
    let uv_from_uv = reference.uv_from_uv;
    let [x, y, origin] = [uv_from_uv.x_axis, uv_from_uv.y_axis, uv_from_uv.translation].map(|v: Vec2| v.as_dvec2());
    let uv = x * uv.x + y * uv.y + origin;
    let texture = &scene.textures[reference.texture];
    let image = &scene.images[texture.image];
    let size = image.extent;
    let at = |x: f64, y: f64| {
        let x = wrap(x, size.width, texture.wrap_u);
        texel(image, x, wrap(y, size.height, texture.wrap_v), encoding)
    };
    let place = uv * DVec2::new(size.width.into(), size.height.into());
    if texture.linear { bilinear(place, at) } else { at(place.x.floor(), place.y.floor()) }
}

/// Interpolates the four texels around `place`; the centre of texel (i, j) is at (i + 0.5, j + 0.5).
pub fn bilinear(place: DVec2, at: impl Fn(f64, f64) -> DVec4) -> DVec4 {
    let low = (place - 0.5).floor();
    let f = place - 0.5 - low;
    let top = at(low.x, low.y).lerp(at(low.x + 1.0, low.y), f.x);
    let bottom = at(low.x, low.y + 1.0).lerp(at(low.x + 1.0, low.y + 1.0), f.x);
    top.lerp(bottom, f.y)
}
