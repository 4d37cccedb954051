//! Images for textures and environments.

use std::f32::consts::{PI, TAU};

use diptych::image::{Extent, Image, RgbImage};
use diptych::scene::TexelImage;
use glam::{Vec2, Vec3, vec2, vec3};

/// Returns an image whose texels are functions of column and row.
pub fn painted<T: Clone>(extent: Extent, texel: impl Fn(u32, u32) -> T) -> Image<T> {
    let pixels = (0..extent.area() as u32).map(|i| texel(i % extent.width, i / extent.width)).collect();
    Image { extent, pixels }
}

/// Returns light and dark fields of changing hue, with an alpha that falls off from the middle.
pub fn checker(extent: Extent) -> TexelImage {
    painted(extent, |x, y| {
        let dark = (x + y) % 2 == 1;
        let place = vec2(x as f32 + 0.5, y as f32 + 0.5);
        let from_middle: Vec2 = place / vec2(extent.width as f32, extent.height as f32) - 0.5;
        let alpha = (1.3 - 2.0 * from_middle.length()).clamp(0.0, 1.0);
        let level = if dark { 60 } else { 230 };
        let hue = [x * 180 / extent.width, y * 120 / extent.height].map(|h| h as u8);
        [level, level - hue[0].min(level), level - hue[1].min(level), (alpha * 255.0) as u8]
    })
}

/// A sky that brightens towards the horizon, with a soft sun; dark below.
pub fn sky(extent: Extent) -> RgbImage {
    let sun = vec3(0.5, 0.6, -0.6).normalize();
    painted(extent, |x, y| {
        let azimuth = TAU * ((x as f32 + 0.5) / extent.width as f32 - 0.5);
        let polar = PI * (y as f32 + 0.5) / extent.height as f32;
        let d = vec3(polar.sin() * azimuth.sin(), polar.cos(), -polar.sin() * azimuth.cos());
        let base =
            if d.y > 0.0 { Vec3::lerp(vec3(0.9, 0.95, 1.0), vec3(0.15, 0.3, 0.8), d.y) } else { vec3(0.12, 0.1, 0.08) };
        let glow = 12.0 * d.dot(sun).max(0.0).powi(60);
        (base + glow * vec3(1.0, 0.85, 0.6)).to_array()
    })
}

/// A normal map of waves, tilted by up to 30°.
pub fn waves(extent: Extent) -> TexelImage {
    painted(extent, |x, y| {
        let phase = TAU * vec2(x as f32, y as f32) / vec2(extent.width as f32, extent.height as f32);
        let normal = vec3(0.5 * phase.x.sin(), 0.4 * (phase.y + phase.x).cos(), 1.0).normalize();
        let code = (normal * 0.5 + 0.5) * 255.0;
        [code.x as u8, code.y as u8, code.z as u8, 255]
    })
}

/// Returns an image whose channels have different steps, all above 0.
pub fn steps(extent: Extent) -> TexelImage {
    painted(extent, |x, y| [97, 61, 143, 29].map(|step| (60 + (y * extent.width + x) * step % 196) as u8))
}
