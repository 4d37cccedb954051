//! Trigonometry from plain arithmetic, which is identical on every machine.

use glam::{Affine3A, Mat3A, Vec3, Vec3A};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// Returns sine and cosine of `angle_rad`. The platform's functions may differ in the last bit, which would change the
/// scene.
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    let x = f64::from(angle_rad);
    let quarter = (x * FRAC_2_PI).round();
    let r = x - quarter * FRAC_PI_2;
    let r2 = r * r;
    let sin_terms = [-1.0 / 39_916_800.0, 1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    let cos_terms = [-1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0];
    let horner = |terms: [f64; 6]| terms.iter().fold(0.0, |sum, t| sum * r2 + t);
    let (s, c) = (r * horner(sin_terms), horner(cos_terms));
    let (s, c) = match (quarter as i64).rem_euclid(4) {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    };
    (s as f32, c as f32)
}

/// Returns a rotation about +x: it maps +y towards +z.
pub fn turn_x(angle_rad: f32) -> Affine3A {
    let (s, c) = sin_cos(angle_rad);
    linear(Vec3::X, Vec3::new(0.0, c, s), Vec3::new(0.0, -s, c))
}

/// Returns a rotation about +z: it maps +x towards +y.
pub fn turn_z(angle_rad: f32) -> Affine3A {
    let (s, c) = sin_cos(angle_rad);
    linear(Vec3::new(c, s, 0.0), Vec3::new(-s, c, 0.0), Vec3::Z)
}

pub fn shift(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

fn linear(x: Vec3, y: Vec3, z: Vec3) -> Affine3A {
    Affine3A { matrix3: Mat3A::from_cols(x.into(), y.into(), z.into()), translation: Vec3A::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_agree_with_the_platform() {
        for i in -2000..2000 {
            let angle = i as f32 * 0.0137;
            let (s, c) = sin_cos(angle);
            assert!((s - angle.sin()).abs() < 1e-6 && (c - angle.cos()).abs() < 1e-6, "{angle}");
        }
    }
}
