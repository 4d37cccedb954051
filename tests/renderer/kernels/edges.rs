//! Edge-stopping weights of spatial filters.

use glam::DVec3;

use super::camera::Eye;
use super::pack::{NO_NORMAL, luminance, position, unpack_normal};

#[derive(Clone, Copy, Debug)]
pub struct Surface {
    pub position: DVec3,
    pub normal: DVec3,
}

impl Surface {
    pub fn unpack(bits: [u32; 4]) -> Option<Self> {
        (bits[3] != NO_NORMAL).then(|| Self { position: position(bits), normal: unpack_normal(bits[3]) })
    }

    /// Returns the maximum distance to the plane that counts as the same surface, for a fraction of the distance to the
    /// eye.
    pub fn reach(&self, eye: &Eye, share: f64) -> f64 {
        share * self.position.distance(eye.origin.as_dvec3())
    }

    /// Returns the similarity of `tap` to this surface, reduced by another `difference` between the pixels. It is the
    /// eighth power of the cosine between the normals times a Gaussian of the tap's distance to this surface's plane.
    pub fn weight(&self, reach: f64, tap: &Self, difference: f64) -> f64 {
        let cosine = self.normal.dot(tap.normal).max(0.0);
        let off = self.normal.dot(tap.position - self.position) / reach;
        cosine.powi(8) * (-(off * off + difference).min(40.0)).exp()
    }
}

/// Compresses a colour for comparison.
pub fn comparable(c: DVec3) -> DVec3 {
    c / (1.0 + luminance(c))
}
