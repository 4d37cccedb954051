//! Numbers that are identical on every machine: trigonometry from plain arithmetic, and random numbers from a hash.

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

pub fn sin(angle_rad: f32) -> f32 {
    sin_cos(angle_rad).0
}

pub fn cos(angle_rad: f32) -> f32 {
    sin_cos(angle_rad).1
}

/// Returns a counter-clockwise rotation about +y seen from above: it maps +z towards +x.
pub fn turn_y(angle_rad: f32) -> Affine3A {
    let (s, c) = sin_cos(angle_rad);
    linear(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c))
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

/// Returns a rotation by a number of quarter turns about +y, without rounding errors.
pub fn quarter_turn_y(quarters: i32) -> Affine3A {
    let (s, c) = match quarters.rem_euclid(4) {
        0 => (0.0, 1.0),
        1 => (1.0, 0.0),
        2 => (0.0, -1.0),
        _ => (-1.0, 0.0),
    };
    linear(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c))
}

pub fn shift(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

pub fn scale(factor: f32) -> Affine3A {
    Affine3A::from_scale(Vec3::splat(factor))
}

fn linear(x: Vec3, y: Vec3, z: Vec3) -> Affine3A {
    Affine3A { matrix3: Mat3A::from_cols(x.into(), y.into(), z.into()), translation: Vec3A::ZERO }
}

/// Returns a well-mixed 32-bit hash.
pub fn hash(mut x: u32) -> u32 {
    x = x.wrapping_add(0x6A09_E667);
    for (shift, factor) in [(16, 0xD1B5_4A35), (13, 0xA24B_AED5), (15, 0x9FB2_1C65)] {
        x = (x ^ (x >> shift)).wrapping_mul(factor);
    }
    x ^ (x >> 16)
}

/// Returns the hash of `x`, mapped to 0..1.
pub fn hash_unit(x: u32) -> f32 {
    (hash(x) >> 8) as f32 / (1 << 24) as f32
}

/// A pseudorandom number generator that depends only on its seed.
#[derive(Clone, Debug)]
pub struct Dice {
    state: u32,
}

impl Dice {
    pub fn new(seed: u32) -> Self {
        Self { state: hash(seed) }
    }

    /// Returns a number in 0..1.
    pub fn unit(&mut self) -> f32 {
        self.state = self.state.wrapping_add(0x9E37_79B9);
        hash_unit(self.state)
    }

    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Returns an angle in 0..2π.
    pub fn angle(&mut self) -> f32 {
        self.range(0.0, std::f32::consts::TAU)
    }
}

/// Returns smooth noise in 0..1 with features about one unit wide and a period of `period` units.
pub fn noise(x: f32, y: f32, period: u32, seed: u32) -> f32 {
    let (x0, y0) = (x.floor(), y.floor());
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (tx, ty) = (ease(x - x0), ease(y - y0));
    let corner = |dx: i32, dy: i32| {
        let wrap = |v: i32| v.rem_euclid(period as i32) as u32;
        let (ix, iy) = (wrap(x0 as i32 + dx), wrap(y0 as i32 + dy));
        hash_unit(ix.wrapping_mul(0x0001_F123) ^ iy.wrapping_mul(0x3C6E_F35F) ^ hash(seed))
    };
    let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
    lerp(lerp(corner(0, 0), corner(1, 0), tx), lerp(corner(0, 1), corner(1, 1), tx), ty)
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

    #[test]
    fn the_hash_fills_the_unit_interval_evenly() {
        let mut dice = Dice::new(7);
        let n = 4096;
        let mut bins = [0; 16];
        (0..n).for_each(|_| bins[(dice.unit() * 16.0) as usize] += 1);
        // The 99.99 % quantile of chi-square with 15 degrees of freedom.
        let expected = n as f32 / 16.0;
        let chi2: f32 = bins.iter().map(|&b| (b as f32 - expected).powi(2) / expected).sum();
        assert!(chi2 < 44.3, "{chi2}");
    }
}
