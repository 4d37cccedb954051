//! GGX microfacets in a frame whose z is the normal: distribution, visibility and sampling.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::sampling::tangents;

/// An orthonormal base whose z is a normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    x: DVec3,
    y: DVec3,
    pub z: DVec3,
}

impl Frame {
    pub fn around(z: DVec3) -> Self {
        let (x, y) = tangents(z);
        Self { x, y, z }
    }

    pub fn local(&self, world: DVec3) -> DVec3 {
        DVec3::new(world.dot(self.x), world.dot(self.y), world.dot(self.z))
    }

    pub fn world(&self, local: DVec3) -> DVec3 {
        self.x * local.x + self.y * local.y + self.z * local.z
    }
}

/// The isotropic distribution of Trowbridge & Reitz (1975), in the form of Walter et al. (2007).
#[derive(Clone, Copy, Debug)]
pub struct Ggx {
    pub alpha: f64,
}

impl Ggx {
    /// Returns the area of microfacets with the unit normal `h` per solid angle and area of surface.
    pub fn distribution(&self, h: DVec3) -> f64 {
        if h.z <= 0.0 {
            return 0.0;
        }
        let a2 = self.alpha * self.alpha;
        let spread = h.x * h.x + h.y * h.y + a2 * h.z * h.z;
        a2 / (PI * spread * spread)
    }

    /// Returns √(α² + (1 − α²) cos²), a common term of Smith's functions.
    fn root(&self, cosine: f64) -> f64 {
        let a2 = self.alpha * self.alpha;
        (a2 + (1.0 - a2) * cosine * cosine).sqrt()
    }

    /// Returns the visible fraction of the microfacets that face a direction at that (positive) cosine.
    pub fn masking(&self, cosine: f64) -> f64 {
        2.0 * cosine / (cosine + self.root(cosine))
    }

    /// Returns height-correlated masking and shadowing over 4 cos cos (Heitz 2014, equation 99), for positive cosines.
    pub fn visibility(&self, cos_v: f64, cos_l: f64) -> f64 {
        0.5 / (cos_l * self.root(cos_v) + cos_v * self.root(cos_l))
    }

    /// Samples a microfacet's normal among those visible from `v` (v.z > 0) (Heitz 2018, listing 1).
    pub fn sample(&self, v: DVec3, u: [f64; 2]) -> DVec3 {
        let stretched = DVec3::new(self.alpha * v.x, self.alpha * v.y, v.z).normalize();
        let frame = Frame::around(stretched);
        // x lies along the projection of the plane's normal, because the occluded half of the disc is there.
        let x = DVec3::Z.cross(stretched).try_normalize().unwrap_or(frame.x);
        let y = stretched.cross(x);
        let (radius, phi) = (u[0].sqrt(), TAU * u[1]);
        let (p, whole) = (radius * phi.cos(), radius * phi.sin());
        let s = 0.5 * (1.0 + stretched.z);
        let q = (1.0 - s) * (1.0 - p * p).max(0.0).sqrt() + s * whole;
        let n = x * p + y * q + stretched * (1.0 - p * p - q * q).max(0.0).sqrt();
        DVec3::new(self.alpha * n.x, self.alpha * n.y, n.z.max(0.0)).normalize()
    }

    /// Returns the density of [`Self::sample`] by solid angle of the normal.
    pub fn density(&self, v: DVec3, h: DVec3) -> f64 {
        self.masking(v.z) * self.distribution(h) * v.dot(h).max(0.0) / v.z
    }
}

pub fn reflect(v: DVec3, h: DVec3) -> DVec3 {
    h * (2.0 * v.dot(h)) - v
}

/// Returns the direction of light that a facet `h` on v's side refracts to `v`; none at total internal reflection.
/// `ratio` is the index on v's side over the one beyond.
pub fn refract(v: DVec3, h: DVec3, ratio: f64) -> Option<DVec3> {
    let cosine = v.dot(h);
    let sin2_beyond = ratio * ratio * (1.0 - cosine * cosine).max(0.0);
    let beyond = (sin2_beyond < 1.0).then(|| (1.0 - sin2_beyond).sqrt())?;
    Some((h * (ratio * cosine - beyond) - v * ratio).normalize())
}
