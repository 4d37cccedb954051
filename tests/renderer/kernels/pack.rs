//! Formats of light, albedo, normals and counts in images, in plain Rust.

use exr::prelude::f16;
use glam::{DVec2, DVec3};

/// Flag in the last word of the `hit` image: several surfaces share the pixel, or its contents depend on the viewpoint.
pub const MIXED: u32 = 0x8000_0000;
pub const VIEW_DEPENDENT: u32 = 0x4000_0000;
pub const MATERIAL_MASK: u32 = 0x00ff_ffff;
/// Bit of the material of surfaces seen in mirrors.
pub const MIRRORED: u32 = 0x0080_0000;

/// Value in place of a packed normal: there is no surface to light.
pub const NO_NORMAL: u32 = 0x8000_8000;

/// Last word of radiance that was sampled in this frame.
pub const SAMPLED: u32 = 0x3f80_0000;

/// Flag in that word, which then contains the variance of samples.
pub const TELLS_VARIANCE: u32 = 0x8000_0000;

/// Value in place of an unknown variance.
pub const UNKNOWN: f64 = -1.0;
pub const MISSING: f64 = -2.0;
/// Value in place of the variance of light that has been filtered already.
pub const FINISHED: f64 = -4.0;

/// Relative rounding error of a half float, with a margin for drivers that round towards zero.
pub const HALF: f64 = 1.0 / 1024.0;
/// Smallest step of half floats.
pub const HALF_STEP: f64 = 1.0 / 16_777_216.0;
const MOST_HALF: f64 = 65504.0;

pub fn pair(a: f64, b: f64) -> u32 {
    let half = |v: f64| u32::from(f16::from_f32(v.min(MOST_HALF) as f32).to_bits());
    half(a) | half(b) << 16
}

pub fn halves(bits: u32) -> [f64; 2] {
    [bits as u16, (bits >> 16) as u16].map(|half| f16::from_bits(half).to_f64())
}

/// Returns true if every component is finite as a float.
pub fn is_finite(v: DVec3) -> bool {
    v.as_vec3().is_finite()
}

pub fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Packs a unit vector as a point of the octahedron |x| + |y| + |z| = 1, whose lower half is folded outwards over the
/// upper.
pub fn pack_normal(n: DVec3) -> u32 {
    let p = DVec2::new(n.x, n.y) / (n.x.abs() + n.y.abs() + n.z.abs());
    let folded = if n.z < 0.0 { fold(p) } else { p };
    let snorm = |v: f64| u32::from((v.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    snorm(folded.x) | snorm(folded.y) << 16
}

pub fn unpack_normal(bits: u32) -> DVec3 {
    let snorm = |half: u32| (f64::from(half as u16 as i16) / 32767.0).max(-1.0);
    let p = DVec2::new(snorm(bits), snorm(bits >> 16));
    let z = 1.0 - p.x.abs() - p.y.abs();
    let p = if z < 0.0 { fold(p) } else { p };
    DVec3::new(p.x, p.y, z).normalize()
}

/// Mirrors a point of the square's corner triangles at the diamond's edge; inverts itself.
fn fold(p: DVec2) -> DVec2 {
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
    DVec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
}

pub fn position(bits: [u32; 4]) -> DVec3 {
    DVec3::from_array([bits[0], bits[1], bits[2]].map(|b| f64::from(f32::from_bits(b))))
}

pub fn pack_guide(position: DVec3, normal: DVec3) -> [u32; 4] {
    let [x, y, z] = position.to_array().map(|v| (v as f32).to_bits());
    [x, y, z, pack_normal(normal)]
}

/// Returns three floats and a fourth.
pub fn floats(color: DVec3, fourth: f64) -> [f32; 4] {
    [color.x as f32, color.y as f32, color.z as f32, fourth as f32]
}

pub fn rgb(texel: [f32; 4]) -> DVec3 {
    DVec3::new(texel[0].into(), texel[1].into(), texel[2].into())
}

/// Counts of a pixel: rays, dropped samples, the reason for a hole, and a flag for clipped light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    pub rays: u32,
    pub dropped: u32,
    pub why: u32,
    pub clipped: bool,
}

impl Counts {
    /// Value of [`Self::why`] for a pixel that is no hole, but left to the denoiser.
    pub const SKIPPED: u32 = 7;

    pub fn unpack(bits: u32) -> Self {
        Self { rays: bits & 0xf_ffff, dropped: (bits >> 20) & 0xff, why: (bits >> 28) & 7, clipped: bits >> 31 == 1 }
    }

    pub fn pack(self) -> u32 {
        self.rays.min(0xf_ffff) | self.dropped.min(0xff) << 20 | self.why << 28 | u32::from(self.clipped) << 31
    }

    pub fn with_dropped(self, more: u32) -> Self {
        Self { dropped: (self.dropped + more).min(0xff), ..self }
    }
}

/// Light of a channel that the surface does not reflect. Any negative light means the same.
pub const ABSENT: f64 = -1.0;

/// Sum of weights up to which a filter leaves a channel absent.
pub const LEAST_WEIGHT: f64 = 1e-6;

/// Square of an invisible difference in luminance.
pub const UNSEEN_SQUARE: f64 = 1e-20;

/// Returns light in which each channel that `is_absent` accepts is absent.
fn without(light: DVec3, is_absent: impl Fn(usize) -> bool) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|c| if is_absent(c) { ABSENT } else { light[c] }))
}

/// Returns true if all channels of a lobe are absent.
pub fn is_absent(light: DVec3) -> bool {
    light.cmplt(DVec3::ZERO).all()
}

/// Weighted mean of light, in which absent channels have no weight.
#[derive(Clone, Copy, Default)]
pub struct MeanLight {
    sum: DVec3,
    weight: DVec3,
}

impl MeanLight {
    pub fn add(&mut self, light: DVec3, weight: f64) {
        for c in (0..3).filter(|&c| light[c].is_nan() || light[c] >= 0.0) {
            self.sum[c] += light[c] * weight;
            self.weight[c] += weight;
        }
    }

    /// Returns true if the sums of all channels are finite as floats.
    pub fn is_finite(&self) -> bool {
        is_finite(self.sum)
    }

    /// Returns the mean, whose channels are absent if their weight is not above `least`.
    pub fn above(&self, least: f64) -> DVec3 {
        without(self.sum / self.weight, |c| self.weight[c] <= least)
    }
}

/// Blends light with its history. If a channel is absent in one of them, the other takes its place.
pub fn blended(past: DVec3, now: DVec3, fraction: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|c| match (past[c] < 0.0, now[c] < 0.0) {
        (true, _) => now[c],
        (_, true) => past[c],
        _ => past[c] + fraction * (now[c] - past[c]),
    }))
}

/// Returns the luminance that a lobe would have if its absent channels were as bright as the others.
fn lobe_luminance(light: DVec3) -> f64 {
    let known = luminance(light.map(|v| if v < 0.0 { 0.0 } else { 1.0 }));
    if known == 0.0 { 0.0 } else { luminance(light.map(|v| if v < 0.0 { 0.0 } else { v })) / known }
}

/// Demodulated light of the Lambertian lobe and of facets, with the variance of the luminance of each.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Light {
    pub matte: DVec3,
    pub gloss: DVec3,
    pub variance: DVec2,
}

impl Light {
    pub fn luminances(&self) -> DVec2 {
        DVec2::new(lobe_luminance(self.matte), lobe_luminance(self.gloss)).min(DVec2::splat(1e18))
    }

    /// Returns 1 for each lobe that has light, 0 for one that is absent.
    pub fn lobes(&self) -> DVec2 {
        DVec2::from_array([self.matte, self.gloss].map(|light| f64::from(!is_absent(light))))
    }

    /// Returns the light as if absent light were black.
    pub fn unmarked(&self) -> Self {
        let unmarked = |light: DVec3| light.map(|v| if v < 0.0 { 0.0 } else { v });
        Self { matte: unmarked(self.matte), gloss: unmarked(self.gloss), ..*self }
    }

    /// Returns the light, absent where the albedo is 0.
    pub fn reflected_by(&self, albedo: &Albedo) -> Self {
        let gloss = albedo.all - albedo.matte;
        let matte = without(self.matte, |c| albedo.matte[c] <= 1e-6);
        Self { matte, gloss: without(self.gloss, |c| gloss[c] <= 1e-6), ..*self }
    }
}

/// Albedo under uniform light in total and of the Lambertian lobe, and the roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Albedo {
    pub all: DVec3,
    pub matte: DVec3,
    pub roughness: f64,
}

/// Packs two variances as standard deviations. Negative values mean no variance and stay as they are.
pub fn pack_variances(variances: DVec2) -> u32 {
    let [x, y] = variances.to_array().map(|v| if v < 0.0 { v } else { v.sqrt() });
    pair(x, y)
}

pub fn unpack_variances(bits: u32) -> DVec2 {
    let variance = |deviation: f64| if deviation < 0.0 { deviation } else { deviation.powi(2) };
    DVec2::from_array(halves(bits).map(variance))
}

/// Format of light: half floats with specular radiance, else floats.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    pub gloss: bool,
}

impl Format {
    pub fn unpack(&self, bits: [u32; 4]) -> Light {
        if !self.gloss {
            let [r, g, b, a] = bits.map(|b| f64::from(f32::from_bits(b)));
            return Light { matte: DVec3::new(r, g, b), gloss: DVec3::ZERO, variance: DVec2::splat(a) };
        }
        let ([mr, mg], [mb, gr], [gg, gb]) = (halves(bits[0]), halves(bits[1]), halves(bits[2]));
        Light { matte: DVec3::new(mr, mg, mb), gloss: DVec3::new(gr, gg, gb), variance: unpack_variances(bits[3]) }
    }

    pub fn pack(&self, light: &Light) -> [u32; 4] {
        if !self.gloss {
            return floats(light.matte, light.variance.x).map(f32::to_bits);
        }
        let Light { matte, gloss, variance } = *light;
        [pair(matte.x, matte.y), pair(matte.z, gloss.x), pair(gloss.y, gloss.z), pack_variances(variance)]
    }

    /// Packs light that was sampled in this frame.
    pub fn pack_sampled(&self, light: &Light) -> [u32; 4] {
        let [x, y, z, _] = self.pack(light);
        [x, y, z, SAMPLED]
    }

    /// Packs sampled light with the variance of its samples.
    pub fn pack_sampled_with(&self, light: &Light) -> [u32; 4] {
        let [x, y, z, w] = self.pack(light);
        [x, y, z, w | TELLS_VARIANCE]
    }

    /// Unpacks light, if it was sampled in this frame. Its variance is negative if unknown.
    pub fn unpack_sampled(&self, [x, y, z, w]: [u32; 4]) -> Option<Light> {
        let light = self.unpack([x, y, z, w & !TELLS_VARIANCE]);
        let told = if w & TELLS_VARIANCE != 0 { light.variance } else { DVec2::splat(UNKNOWN) };
        (w != 0).then_some(Light { variance: told, ..light })
    }

    pub fn unpack_albedo(&self, bits: [u32; 4]) -> Albedo {
        if !self.gloss {
            let [r, g, b, roughness] = bits.map(|b| f64::from(f32::from_bits(b)));
            return Albedo { all: DVec3::new(r, g, b), matte: DVec3::new(r, g, b), roughness };
        }
        let [[gr, gg], [gb, roughness], [mr, mg], [mb, _]] = bits.map(halves);
        let matte = DVec3::new(mr, mg, mb);
        Albedo { all: matte + DVec3::new(gr, gg, gb), matte, roughness }
    }

    pub fn pack_albedo(&self, albedo: &Albedo) -> [u32; 4] {
        if !self.gloss {
            return floats(albedo.all, albedo.roughness).map(f32::to_bits);
        }
        let (gloss, matte) = ((albedo.all - albedo.matte).max(DVec3::ZERO), albedo.matte);
        [pair(gloss.x, gloss.y), pair(gloss.z, albedo.roughness), pair(matte.x, matte.y), pair(matte.z, 0.0)]
    }

    /// Returns true if an image holds this light as sampled in this frame, within a relative error. It has a variance
    /// unless that is negative.
    pub fn holds_sampled(&self, [x, y, z, w]: [u32; 4], light: &Light, relative: f64) -> bool {
        if light.variance.x < 0.0 {
            return w == SAMPLED && self.holds([x, y, z, 0], &Light { variance: DVec2::ZERO, ..*light }, relative, 0.0);
        }
        w & TELLS_VARIANCE != 0 && self.holds([x, y, z, w & !TELLS_VARIANCE], light, relative, 0.0)
    }

    /// Returns true if an image holds this light within a relative error of `relative`, an error of the variance of
    /// `variance`, and the rounding of its format.
    pub fn holds(&self, bits: [u32; 4], light: &Light, relative: f64, variance: f64) -> bool {
        let (got, want) = (self.unpack(bits), self.unpack(self.pack(light)));
        let relative = if self.gloss { relative + HALF } else { relative };
        let step = if self.gloss { 2.0 * HALF_STEP } else { 0.0 };
        let near = |a: f64, b: f64| is_near(a, b, relative, step);
        // The format holds the root, so its relative error counts twice.
        let near_variance = |a: f64, b: f64| match a >= 0.0 && b >= 0.0 {
            true => is_near(a, b, 2.0 * relative, variance + (2.0 * b.sqrt() + step) * step),
            false => a == b,
        };
        (0..3).all(|c| near(got.matte[c], want.matte[c]) && near(got.gloss[c], want.gloss[c]))
            && (0..2).all(|c| near_variance(got.variance[c], want.variance[c]))
    }
}

/// Returns true if `got` differs by at most these errors. NaN never matches.
pub fn is_near(got: f64, want: f64, relative: f64, absolute: f64) -> bool {
    (got - want).abs() <= relative * want.abs() + absolute
}
