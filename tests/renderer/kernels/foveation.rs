//! The sampling mask and the foveated layers.

use glam::DVec2;

use super::camera::Constants;

impl Constants {
    fn gaze_distance(&self, (x, y): (u32, u32), view: usize) -> f64 {
        (DVec2::new(x.into(), y.into()) + 0.5).distance(self.foveation.gaze[view].as_dvec2())
    }

    /// Returns a pixel's layer: 0 is the inner layer, 2 the outer one.
    pub fn layer(&self, pixel: (u32, u32), view: usize) -> usize {
        if !self.foveation.layers {
            return 0;
        }
        let distance = self.gaze_distance(pixel, view);
        let radii = self.foveation.radii.as_dvec2();
        usize::from(distance >= radii.x) + usize::from(distance >= radii.y)
    }

    /// Returns a pixel's sampling probability. With layers, it falls linearly from the inner layer's rim to the outer
    /// layer's.
    pub fn sampling_probability(&self, pixel: (u32, u32), view: usize) -> f64 {
        let share = f64::from(self.foveation.sampled_fraction);
        if !self.foveation.layers {
            return share;
        }
        let radii = self.foveation.radii.as_dvec2();
        let outward = ((self.gaze_distance(pixel, view) - radii.x) / (radii.y - radii.x)).clamp(0.0, 1.0);
        share * (1.0 - f64::from(self.foveation.unsampled_fraction) * outward)
    }

    /// Returns true if the mask samples a pixel: the threshold is its Owen-scrambled index on the Z curve.
    pub fn is_sampled(&self, pixel: (u32, u32), view: usize) -> bool {
        let threshold = owen_scrambled(z_curve(pixel)).reverse_bits().wrapping_add(self.foveation.mask_turn);
        f64::from(threshold >> 8) / f64::from(1 << 24) < self.sampling_probability(pixel, view)
    }
}

/// Interleaves the bits of x and y.
fn z_curve((x, y): (u32, u32)) -> u32 {
    (0..16).map(|bit| (x >> bit & 1) << (2 * bit) | (y >> bit & 1) << (2 * bit + 1)).sum()
}

/// Scrambles by the hash of Laine and Karras with the constants of Burley 2020: every bit depends on those below it.
fn owen_scrambled(value: u32) -> u32 {
    let start = value.wrapping_add(0x5f37_59df);
    [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6u32].iter().fold(start, |x, &c| x ^ x.wrapping_mul(c))
}
