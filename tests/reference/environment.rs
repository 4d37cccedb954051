//! The environment: lookups, and sampling of its bright parts.

use std::f64::consts::{PI, TAU};

use diptych::image::RgbImage;
use diptych::scene::{Environment, Wrap};
use glam::{DVec2, DVec3, DVec4};

use super::sampling::Rng;
use super::texture::{bilinear, wrap};

/// Returns the radiance that arrives from infinity against the unit vector `d`, which points there.
pub fn radiance(environment: &Environment, d: DVec3) -> DVec3 {
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

/// Samples directions by texel. The probability of a texel is its solid angle times the brightest value of the texels
/// around it, because filtering spreads that. Directions are uniform in azimuth and height within the texel.
pub struct EnvironmentLight {
    width: u32,
    height: u32,
    rotation_deg: f64,
    /// Cumulative weights of the texels, row by row.
    sums: Vec<f64>,
}

impl EnvironmentLight {
    /// Creates the sampler; none for a constant environment, which is left to bounces.
    pub fn new(environment: &Environment) -> Option<Self> {
        let Environment::Map { image, rotation_deg } = environment else {
            return None;
        };
        let (width, height) = (image.extent.width, image.extent.height);
        let mut light = Self { width, height, rotation_deg: f64::from(*rotation_deg), sums: Vec::new() };
        let mut sum = 0.0;
        for y in 0..height {
            for x in 0..width {
                sum += brightest_around(image, x, y) * light.solid_angle(y);
                light.sums.push(sum);
            }
        }
        (sum > 0.0).then_some(light)
    }

    fn solid_angle(&self, y: u32) -> f64 {
        let cosine = |y: u32| (PI * f64::from(y) / f64::from(self.height)).cos();
        TAU / f64::from(self.width) * (cosine(y) - cosine(y + 1))
    }

    fn weight(&self, index: usize) -> f64 {
        self.sums[index] - if index > 0 { self.sums[index - 1] } else { 0.0 }
    }

    /// Returns a unit direction and its density by solid angle.
    pub fn sample(&self, rng: &mut Rng) -> (DVec3, f64) {
        let total = self.sums[self.sums.len() - 1];
        let pick = rng.uniform() * total;
        let index = self.sums.partition_point(|&sum| sum <= pick).min(self.sums.len() - 1);
        let (x, y) = (index as u32 % self.width, index as u32 / self.width);
        let u = (f64::from(x) + rng.uniform()) / f64::from(self.width);
        let azimuth = TAU * (u - 0.5 - self.rotation_deg / 360.0);
        let [top, bottom] = [y, y + 1].map(|y| (PI * f64::from(y) / f64::from(self.height)).cos());
        let up = top + (bottom - top) * rng.uniform();
        let across = (1.0 - up * up).max(0.0).sqrt();
        let direction = DVec3::new(across * azimuth.sin(), up, -across * azimuth.cos());
        (direction, self.weight(index) / (total * self.solid_angle(y)))
    }

    /// Returns the density of [`Self::sample`] by solid angle.
    pub fn density(&self, d: DVec3) -> f64 {
        let u = 0.5 + d.x.atan2(-d.z) / TAU + self.rotation_deg / 360.0;
        let x = wrap((u * f64::from(self.width)).floor(), self.width, Wrap::Repeat);
        let y = d.y.clamp(-1.0, 1.0).acos() / PI * f64::from(self.height);
        let y = (y as u32).min(self.height - 1);
        let weight = self.weight((y * self.width + x) as usize);
        weight / (self.sums[self.sums.len() - 1] * self.solid_angle(y))
    }
}

fn brightest_around(image: &RgbImage, x: u32, y: u32) -> f64 {
    let mut brightest = 0.0f32;
    for dy in [-1.0, 0.0, 1.0] {
        for dx in [-1.0, 0.0, 1.0] {
            let x = wrap(f64::from(x) + dx, image.extent.width, Wrap::Repeat);
            let y = wrap(f64::from(y) + dy, image.extent.height, Wrap::ClampToEdge);
            brightest = image.get(x, y).iter().fold(brightest, |a, b| a.max(*b));
        }
    }
    f64::from(brightest)
}
