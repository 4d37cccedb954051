//! Regression by the published method (Koskela et al. 2019), solved in f64 by Gram-Schmidt orthogonalisation, which
//! runs twice (Giraud, Langou & Rozložník 2005). The shader uses Householder reflections.

use glam::DVec3;

use crate::kernels::edges::Surface;

pub const BLOCK: u32 = 32;
pub const FEATURES: usize = 10;
/// Minimum length that a feature adds to the preceding ones, relative to its own.
const INDEPENDENT: f64 = 1e-3;
/// Lengths for which rounding decides if a feature is omitted, or how much it counts.
const UNCLEAR: std::ops::Range<f64> = 3e-4..3e-3;

/// Displacement of blocks to the left and upwards, in each of 16 frames.
pub const DISPLACEMENTS: [(u32, u32); 16] = [
    (0, 0),
    (16, 16),
    (16, 0),
    (0, 16),
    (8, 8),
    (24, 24),
    (24, 8),
    (8, 24),
    (8, 0),
    (24, 16),
    (24, 0),
    (8, 16),
    (0, 8),
    (16, 24),
    (16, 8),
    (0, 24),
];

/// Inputs of a pixel in a block.
#[derive(Clone, Copy)]
pub struct Pixel {
    pub surface: Option<Surface>,
    /// Light; none if the pixel has no light.
    pub light: Option<DVec3>,
}

/// Fit of one channel of a lobe.
#[derive(Clone)]
pub struct Fit {
    low: DVec3,
    scale: DVec3,
    weights: [DVec3; FEATURES],
    brightest: f64,
    channel: usize,
    /// True if no pixel has light in the channel.
    pub is_absent: bool,
    /// Minimum length that a feature adds to the preceding ones, relative to its own. Its inverse amplifies rounding
    /// errors.
    pub least_added: f64,
    /// True if rounding decides nothing.
    pub is_clear: bool,
    /// Number of omitted features.
    pub dropped: usize,
}

impl Fit {
    /// Fits the channels of a block; none without any light. Channels that the same pixels have share a fit.
    pub fn channels(block: &[Pixel]) -> Option<[Self; 3]> {
        let has = |channel: usize| block.iter().map(|p| p.light.is_some_and(|l| l[channel] >= 0.0)).collect::<Vec<_>>();
        let first = Self::new(block, 0)?;
        if has(0) == has(1) && has(0) == has(2) {
            return Some([0, 1, 2].map(|channel| Self { channel, ..first.clone() }));
        }
        Some([first, Self::new(block, 1)?, Self::new(block, 2)?])
    }

    /// Fits a channel of a block; none without any light.
    fn new(block: &[Pixel], channel: usize) -> Option<Self> {
        let lit: Vec<(Surface, DVec3)> = block.iter().filter_map(|p| Some((p.surface?, p.light?))).collect();
        if lit.is_empty() {
            return None;
        }
        let low = lit.iter().map(|(s, _)| s.position).reduce(DVec3::min)?;
        let high = lit.iter().map(|(s, _)| s.position).reduce(DVec3::max)?;
        let scale = DVec3::from_array(std::array::from_fn(|c| {
            let is_wide = high[c] - low[c] > 2e-6 * low[c].abs().max(high[c].abs());
            if is_wide { 1.0 / (high[c] - low[c]) } else { 0.0 }
        }));
        let brightest = lit.iter().map(|(_, light)| light.max_element()).fold(0.0, f64::max);
        let mut fit = Self {
            low,
            scale,
            weights: [DVec3::ZERO; FEATURES],
            brightest,
            channel,
            is_absent: true,
            least_added: 1.0,
            is_clear: true,
            dropped: 0,
        };
        let lit: Vec<_> = lit.into_iter().filter(|(_, light)| light[channel] >= 0.0).collect();
        fit.is_absent = lit.is_empty();
        let rows: Vec<[f64; FEATURES]> = lit.iter().map(|(surface, _)| fit.features(surface)).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        // Kept features, each with its direction and the components of its column along the directions so far.
        let mut kept: Vec<(usize, Vec<f64>, Vec<f64>)> = Vec::new();
        for m in 0..FEATURES {
            let mut rest: Vec<f64> = rows.iter().map(|row| row[m]).collect();
            let length = dot(&rest, &rest).sqrt();
            let mut made_of = vec![0.0; kept.len()];
            for _ in 0..2 {
                for (part, (_, direction, _)) in made_of.iter_mut().zip(&kept) {
                    let along = dot(direction, &rest);
                    *part += along;
                    rest.iter_mut().zip(direction).for_each(|(r, d)| *r -= along * d);
                }
            }
            let added = dot(&rest, &rest).sqrt();
            fit.is_clear &= length == 0.0 || !UNCLEAR.contains(&(added / length));
            if added > INDEPENDENT * length {
                fit.least_added = fit.least_added.min(added / length);
                rest.iter_mut().for_each(|r| *r /= added);
                made_of.push(added);
                kept.push((m, rest, made_of));
            }
        }
        fit.dropped = FEATURES - kept.len();
        for k in (0..kept.len()).rev() {
            let (m, direction, made_of) = &kept[k];
            let mut along = direction.iter().zip(&lit).map(|(d, (_, light))| *light * *d).sum::<DVec3>();
            for (later, _, parts) in &kept[k + 1..] {
                along -= parts[k] * fit.weights[*later];
            }
            fit.weights[*m] = along / made_of[k];
        }
        Some(fit)
    }

    fn features(&self, surface: &Surface) -> [f64; FEATURES] {
        let (n, x) = (surface.normal, (surface.position - self.low) * self.scale);
        [1.0, n.x, n.y, n.z, x.x, x.y, x.z, x.x * x.x, x.y * x.y, x.z * x.z]
    }

    /// Returns the fitted light of a surface in the block, in this channel.
    pub fn light(&self, surface: &Surface) -> f64 {
        let features = self.features(surface);
        let sum = self.weights.iter().zip(features).map(|(w, f)| *w * f).sum::<DVec3>();
        sum[self.channel].clamp(0.0, self.brightest)
    }

    pub fn brightest(&self) -> f64 {
        self.brightest
    }
}
