//! Packs the statistics of a pixel's history.

use glam::DVec2;

use crate::kernels::pack::{Format, MATERIAL_MASK, halves, pack_variances, pair, unpack_variances};

/// Statistics of a pixel's history.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    /// Mean luminance of diffuse and specular radiance, with the variance of a sample.
    pub mean: DVec2,
    pub variance: DVec2,
    /// Mean luminance of diffuse radiance over the last frames.
    pub recent: f64,
    pub samples: f64,
    pub frames: f64,
    pub material: u32,
}

/// Returns the power of two in a positive number that is a float; for 0 the smallest one.
fn power_of_two_in(mean: f64) -> f64 {
    f64::from(f32::from_bits(((mean.max(0.0) as f32).to_bits() & 0x7f80_0000).max(0x0080_0000)))
}

impl Moments {
    pub fn unpack(format: Format, bits: [u32; 4]) -> Self {
        let float = |bits| f64::from(f32::from_bits(bits));
        let (mean, variance) = if format.gloss {
            (DVec2::from_array(halves(bits[0])), unpack_variances(bits[1]))
        } else {
            (DVec2::new(float(bits[0]), 0.0), DVec2::new(float(bits[1]), 0.0))
        };
        let [samples, recent] = halves(bits[2]);
        Self {
            mean,
            variance,
            recent: recent * power_of_two_in(mean.x),
            samples,
            frames: f64::from(bits[3] >> 24),
            material: bits[3] & MATERIAL_MASK,
        }
    }

    /// Packs the statistics. Frame counts are rounded down.
    pub fn pack(&self, format: Format) -> [u32; 4] {
        let float = |v: f64| (v as f32).to_bits();
        let [x, y] = if format.gloss {
            [pair(self.mean.x, self.mean.y), pack_variances(self.variance)]
        } else {
            [float(self.mean.x), float(self.variance.x)]
        };
        let unit = power_of_two_in(Self::unpack(format, [x, y, 0, 0]).mean.x);
        [x, y, pair(self.samples, self.recent / unit), self.material | (self.frames as u32) << 24]
    }
}
