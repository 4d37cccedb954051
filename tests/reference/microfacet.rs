//! GGX microfacets in a frame whose z is the normal: distribution, visibility and sampling.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::layer::SMOOTH_ALPHA;
use super::sampling::tangents;

/// An orthonormal base whose z is a normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    x: DVec3,
    y: DVec3,
    pub z: DVec3,
}

impl Frame {
    /// `x` is a unit vector orthogonal to `z`.
    pub fn along(x: DVec3, z: DVec3) -> Self {
        Self { x, y: z.cross(x), z }
    }

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

/// The distribution of Trowbridge & Reitz (1975), in the form of Walter et al. (2007), stretched along x and y (Heitz
/// 2014, equation 85).
#[derive(Clone, Copy, Debug)]
pub struct Ggx {
    alpha: [f64; 2],
}

impl Ggx {
    pub fn even(alpha: f64) -> Self {
        Self { alpha: [alpha; 2] }
    }

    /// Returns facets of different widths along x and along y.
    pub fn uneven(alpha: [f64; 2]) -> Self {
        Self { alpha }
    }

    pub fn is_smooth(&self) -> bool {
        self.alpha.iter().all(|alpha| *alpha < SMOOTH_ALPHA)
    }

    /// Returns the area of microfacets with the unit normal `h` per solid angle and area of surface.
    pub fn distribution(&self, h: DVec3) -> f64 {
        if h.z <= 0.0 {
            return 0.0;
        }
        let [x, y] = self.alpha;
        let spread = h.x * h.x * y / x + h.y * h.y * x / y + x * y * h.z * h.z;
        x * y / (PI * spread * spread)
    }

    /// Returns √(αx² x² + αy² y² + z²), a common term of Smith's functions.
    fn root(&self, w: DVec3) -> f64 {
        let [x, y] = self.alpha;
        (w * DVec3::new(x, y, 1.0)).length()
    }

    /// Returns the visible fraction of the microfacets that face a direction above the surface.
    pub fn masking(&self, v: DVec3) -> f64 {
        2.0 * v.z / (v.z + self.root(v))
    }

    /// Returns height-correlated masking and shadowing over 4 cos cos (Heitz 2014, equation 99). Neither direction needs
    /// to be above the surface.
    pub fn visibility(&self, v: DVec3, l: DVec3) -> f64 {
        0.5 / (l.z.abs() * self.root(v) + v.z.abs() * self.root(l))
    }

    /// Samples a microfacet's normal among those visible from `v` (v.z > 0) (Heitz 2018, listing 1).
    pub fn sample(&self, v: DVec3, u: [f64; 2]) -> DVec3 {
        let alpha = DVec3::new(self.alpha[0], self.alpha[1], 1.0);
        let stretched = (alpha * v).normalize();
        let frame = Frame::around(stretched);
        // x lies along the projection of the plane's normal, because the occluded half of the disc is there.
        let x = DVec3::Z.cross(stretched).try_normalize().unwrap_or(frame.x);
        let y = stretched.cross(x);
        let (radius, phi) = (u[0].sqrt(), TAU * u[1]);
        let (p, whole) = (radius * phi.cos(), radius * phi.sin());
        let s = 0.5 * (1.0 + stretched.z);
        let q = (1.0 - s) * (1.0 - p * p).max(0.0).sqrt() + s * whole;
        let n = x * p + y * q + stretched * (1.0 - p * p - q * q).max(0.0).sqrt();
        (alpha * DVec3::new(n.x, n.y, n.z.max(0.0))).normalize()
    }

    /// Returns the density of [`Self::sample`] by solid angle of the normal.
    pub fn density(&self, v: DVec3, h: DVec3) -> f64 {
        self.masking(v) * self.distribution(h) * v.dot(h).max(0.0) / v.z
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
