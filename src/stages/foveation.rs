//! Foveation in three layers around the gaze, and the shader constants that describe it.

use glam::{Vec2, Vec4};

use super::layout;
use crate::image::Extent;
use crate::scene::optics::Optics;
use crate::scene::rig::Eye;
use crate::scene::shot::Gaze;

/// Sampling and filtering in layers around the gaze (Peres 2022, sections 4.2 and 4.4). The gaze may move with every
/// frame.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Foveation {
    /// Gaze of the left and the right eye.
    pub gaze: [Gaze; 2],
    /// Radii at which the inner and the middle layer end, in increasing order, as fractions of the image's width. A
    /// frame may override them.
    pub radii: [f64; 2],
    /// Fraction of the outer layer's pixels that is not sampled, 0 to 1. Across the middle layer, the fraction falls
    /// linearly to 0.
    pub unsampled_fraction: f64,
}

impl Foveation {
    /// Default radii, from section 5.1 of Peres 2022.
    pub const RADII: [f64; 2] = [0.15, 0.30];

    /// Default fraction of unsampled pixels, from section 4.2 of Peres 2022.
    pub const UNSAMPLED_FRACTION: f64 = 0.5;

    /// Creates layers with the default radii and fraction of unsampled pixels.
    pub fn new(gaze: [Gaze; 2]) -> Self {
        Self { gaze, radii: Self::RADII, unsampled_fraction: Self::UNSAMPLED_FRACTION }
    }

    /// Returns the same layers around a fixed gaze of each eye, in fractions of its image.
    pub fn looking(&self, eyes: [[f64; 2]; 2]) -> Self {
        Self { gaze: eyes.map(|[x, y]| Gaze { path: vec![[0.0, x, y]] }), ..self.clone() }
    }

    /// Returns the [`Self::unsampled_fraction`] with which a fraction `sampled` of the left eye's pixels is sampled at
    /// `time_s`. The result is clamped to 0 to 1.
    pub fn unsampled_fraction_for(&self, sampled: f64, time_s: f64, extent: Extent) -> f64 {
        let ([inner, outer], [x, y]) = self.circles(0, time_s, extent.width, extent.height);
        let columns = extent.width as usize;
        let outward = |i: usize| {
            let distance = f64::hypot((i % columns) as f64 + 0.5 - x, (i / columns) as f64 + 0.5 - y);
            ((distance - inner) / (outer - inner)).clamp(0.0, 1.0)
        };
        let outward: f64 = (0..extent.area()).map(outward).sum();
        let unsampled = (1.0 - sampled) * extent.area() as f64;
        if unsampled < outward { unsampled.max(0.0) / outward } else { 1.0 }
    }

    /// Returns the radii and the gaze of an eye at `time_s` in an image of this size, pixels.
    pub fn circles(&self, eye: usize, time_s: f64, width: u32, height: u32) -> ([f64; 2], [f64; 2]) {
        self.circles_of(self.radii, eye, time_s, width, height)
    }

    /// Returns the same as [`Self::circles`], but for `radii` instead of [`Self::radii`].
    pub fn circles_of(
        &self,
        radii: [f64; 2],
        eye: usize,
        time_s: f64,
        width: u32,
        height: u32,
    ) -> ([f64; 2], [f64; 2]) {
        let [x, y] = self.gaze[eye].at(time_s);
        (radii.map(|r| r * f64::from(width)), [x * f64::from(width), y * f64::from(height)])
    }

    /// Returns the radii and the gaze of both eyes in the rendered images, pixels. If eyes are resampled from a shared
    /// projection (`rectified`), the gaze is mapped to this projection, and the radii are scaled by the ratio of its
    /// pixel density to the eye's at the gaze. If the radii of the eyes differ, the larger ones are returned.
    pub fn circles_rendered(
        &self,
        radii: [f64; 2],
        time_s: f64,
        extent: Extent,
        rectified: Option<(&Optics, Extent)>,
    ) -> ([f64; 2], [[f64; 2]; 2]) {
        let [(left_radii, left), (right_radii, right)] = Eye::ALL.map(|eye| {
            let (radii, gaze) = self.circles_of(radii, eye as usize, time_s, extent.width, extent.height);
            rectified.map_or((radii, gaze), |(optics, grid)| {
                let (gaze, density) = optics.rectified_point(eye, [extent, grid], gaze);
                (radii.map(|radius| radius * density), gaze)
            })
        });
        ([0, 1].map(|i| left_radii[i].max(right_radii[i])), [left, right])
    }

    /// Returns the shader constants of a frame with displayed images of this size. The caller sets `layer_iterations`.
    /// Without radii, the inner layer covers the whole frame.
    pub(crate) fn describe(
        &self,
        extent: Extent,
        time_s: f64,
        radii: Option<[f64; 2]>,
        rectified: Option<(&Optics, Extent)>,
    ) -> layout::Foveation {
        let radii = radii.unwrap_or(EVERYWHERE);
        let (radii, [left, right]) = self.circles_rendered(radii, time_s, extent, rectified);
        layout::Foveation {
            gaze: Vec4::from([left[0], left[1], right[0], right[1]].map(|c| c as f32)),
            unsampled_fraction: self.unsampled_fraction as f32,
            radii: Vec2::from(radii.map(|r| r as f32)),
            ..Default::default()
        }
    }
}

/// Radii beyond any image.
const EVERYWHERE: [f64; 2] = [1e6, 2e6];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_falloff_samples_the_share_that_is_asked_for() {
        let extent = Extent::new(64, 48);
        let gaze = || Gaze { path: vec![[0.0, 0.4, 0.5]] };
        let falloff = |radii| Foveation { radii, ..Foveation::new([gaze(), gaze()]) };
        // Around (25.6, 24), all pixels within 6.4 pixels are sampled. The fraction falls linearly to its floor at 12.8
        // pixels.
        let unsampled = falloff([0.1, 0.2]).unsampled_fraction_for(0.4, 0.0, extent);
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
        assert_eq!(falloff([0.1, 0.2]).unsampled_fraction_for(0.01, 0.0, extent), 1.0);
        assert_eq!(falloff([2.0, 3.0]).unsampled_fraction_for(0.4, 0.0, extent), 1.0);
        assert_eq!(falloff([0.1, 0.2]).unsampled_fraction_for(1.0, 0.0, extent), 0.0);
    }
}
