//! Foveation in three layers around the gaze, and the shader constants that describe it.

use glam::{Vec2, Vec4};

use crate::image::Extent;
use crate::layout;
use crate::scene::optics::Optics;
use crate::scene::rig::Eye;

/// Sampling and filtering in layers around the gaze (Peres 2022, sections 4.2 and 4.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foveation {
    /// Radii at which the inner and the middle layer end, in increasing order, as fractions of the image's width.
    pub radii: [f64; 2],
    /// Fraction of the outer layer's pixels that is not sampled, 0 to 1. Across the middle layer, the fraction falls
    /// linearly to 0.
    pub unsampled_fraction: f64,
}

impl Default for Foveation {
    fn default() -> Self {
        Self { radii: Self::RADII, unsampled_fraction: Self::UNSAMPLED_FRACTION }
    }
}

/// Gazes are in fractions of an eye's displayed image.
impl Foveation {
    /// Default radii, from section 5.1 of Peres 2022.
    pub const RADII: [f64; 2] = [0.15, 0.30];

    /// Default fraction of unsampled pixels, from section 4.2 of Peres 2022.
    pub const UNSAMPLED_FRACTION: f64 = 0.5;

    /// Returns the [`Self::unsampled_fraction`] with which a fraction `sampled` of an eye's pixels is sampled. The result
    /// is clamped to 0 to 1.
    pub fn unsampled_fraction_for(&self, sampled: f64, gaze: [f64; 2], extent: Extent) -> f64 {
        let ([inner, outer], [x, y]) = self.circles(gaze, extent);
        let columns = extent.width as usize;
        let outward = |i: usize| {
            let distance = f64::hypot((i % columns) as f64 + 0.5 - x, (i / columns) as f64 + 0.5 - y);
            ((distance - inner) / (outer - inner)).clamp(0.0, 1.0)
        };
        let outward: f64 = (0..extent.area()).map(outward).sum();
        let unsampled = (1.0 - sampled) * extent.area() as f64;
        if unsampled < outward { unsampled.max(0.0) / outward } else { 1.0 }
    }

    /// Returns the radii and the gaze of an eye in an image of this size, pixels.
    pub fn circles(&self, gaze: [f64; 2], extent: Extent) -> ([f64; 2], [f64; 2]) {
        let [width, height] = [extent.width, extent.height].map(f64::from);
        (self.radii.map(|r| r * width), [gaze[0] * width, gaze[1] * height])
    }

    /// Returns the radii and the gaze of both eyes in the rendered images, pixels. If eyes are resampled from a shared
    /// projection (`rectified`), the gaze is mapped to this projection, and the radii are scaled by the ratio of its
    /// pixel density to the eye's at the gaze. If the radii of the eyes differ, the larger ones are returned.
    pub fn circles_rendered(
        &self,
        gaze: [[f64; 2]; 2],
        extent: Extent,
        rectified: Option<(&Optics, Extent)>,
    ) -> ([f64; 2], [[f64; 2]; 2]) {
        let [(left_radii, left), (right_radii, right)] = Eye::BOTH.map(|eye| {
            let (radii, gaze) = self.circles(gaze[eye.index()], extent);
            rectified.map_or((radii, gaze), |(optics, grid)| {
                let (gaze, density) = optics.rectified_point(eye, [extent, grid], gaze);
                (radii.map(|radius| radius * density), gaze)
            })
        });
        ([0, 1].map(|i| left_radii[i].max(right_radii[i])), [left, right])
    }

    /// Returns the shader constants of a frame with displayed images of this size. The caller sets `layer_iterations`.
    pub(crate) fn describe(
        &self,
        gaze: [[f64; 2]; 2],
        extent: Extent,
        rectified: Option<(&Optics, Extent)>,
    ) -> layout::Foveation {
        let (radii, [left, right]) = self.circles_rendered(gaze, extent, rectified);
        layout::Foveation {
            gaze: Vec4::from([left[0], left[1], right[0], right[1]].map(|c| c as f32)),
            unsampled_fraction: self.unsampled_fraction as f32,
            radii: Vec2::from(radii.map(|r| r as f32)),
            ..Default::default()
        }
    }
}

/// Radii beyond any image, with which the inner layer covers the whole frame.
pub(crate) const EVERYWHERE: [f64; 2] = [1e6, 2e6];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn falloff_samples_the_requested_fraction() {
        let extent = Extent::new(64, 48);
        let unsampled_fraction_for = |radii, sampled| {
            Foveation { radii, ..Default::default() }.unsampled_fraction_for(sampled, [0.4, 0.5], extent)
        };
        // Around (25.6, 24), all pixels within 6.4 pixels are sampled. The fraction falls linearly to its floor at 12.8
        // pixels.
        let unsampled = unsampled_fraction_for([0.1, 0.2], 0.4);
        let mut sampled = 0.0;
        for (x, y) in (0..48).flat_map(|y| (0..64).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5))) {
            let distance = f64::hypot(x - 25.6, y - 24.0);
            sampled += match distance {
                d if d < 6.4 => 1.0,
                d if d < 12.8 => 1.0 - unsampled * (d - 6.4) / 6.4,
                _ => 1.0 - unsampled,
            };
        }
        assert!((sampled / extent.area() as f64 - 0.4).abs() < 1e-9, "{unsampled}: {sampled}");
        // Unreachable fractions are clamped: the inner layer alone samples more than 0.01, and a layer of radius 2
        // covers the whole image.
        assert_eq!(unsampled_fraction_for([0.1, 0.2], 0.01), 1.0);
        assert_eq!(unsampled_fraction_for([2.0, 3.0], 0.4), 1.0);
        assert_eq!(unsampled_fraction_for([0.1, 0.2], 1.0), 0.0);
    }
}
