//! Height of the ground and the path through it.

use super::super::geometry::Surface;
use super::super::maths::{noise, sin};
use glam::{Vec2, Vec3};

/// Returns x of the path's centre line at depth `z`.
pub fn path_x(z: f32) -> f32 {
    1.7 * sin(0.15 * z + 0.6) + 0.6 * sin(0.31 * z)
}

/// Returns the horizontal distance in x from the middle of the path.
pub fn off_path(x: f32, z: f32) -> f32 {
    (x - path_x(z)).abs()
}

/// Returns the height of the ground, metres.
pub fn height(x: f32, z: f32) -> f32 {
    let rolling = 0.55 * sin(0.09 * x + 0.7) * sin(0.075 * z + 0.4) + 0.25 * sin(0.21 * x - 0.13 * z);
    let lumps = 0.16 * noise(x * 0.8 + 512.0, z * 0.8 + 512.0, 1024, 3);
    let away = ((off_path(x, z) - 0.8) / 9.0).clamp(0.0, 1.0);
    let bank = away * away * (3.0 - 2.0 * away);
    rolling + lumps * (0.3 + 0.7 * bank) + 1.5 * bank
}

/// Bounds of the ground in x and z, metres.
const MIN: Vec2 = Vec2::new(-36.0, -54.0);
const MAX: Vec2 = Vec2::new(36.0, 26.0);

pub fn ground() -> Surface {
    Surface::smooth_grid(96, 108, |u, v| {
        let (x, z) = (MIN.x + (MAX.x - MIN.x) * u, MAX.y - (MAX.y - MIN.y) * v);
        Vec3::new(x, height(x, z), z)
    })
    .uv_scaled((MAX - MIN) / 3.0)
}
