//! Tests if two noisy images have the same mean: a z-test per pixel, per block of pixels (8×8, in small images fewer)
//! and for the image.
//!
//! z = (b − a) / √(var a + var b), where a and b are means over samples and var the variances of these means,
//! both estimated from the samples. If the means agree (the null hypothesis), then
//! - z of **a block**, a mean over 64 independent pixels of many samples each, is close to N(0, 1) by the
//!   central limit theorem: mean square 1 ± √(2/N) over N blocks, 0.27 % beyond |z| = 3, the largest of N about
//!   √(2 ln N): 3.0 for 100 blocks, 3.7 for 1,000. The three channels of a block are correlated, so N counts
//!   blocks, not channels, where a spread is derived from it.
//! - z of **the image mean** is N(0, 1): beyond 3.6 once in 3,000.
//! - **Renders** of low-discrepancy points have dependent pixels, whose errors cancel. There, the variance of a block's
//!   or the image's mean is that of its means over K renders, and z follows Student's distribution with the degrees of
//!   freedom of Welch and Satterthwaite. It is converted to the normal deviate of the same probability (Wallace 1959),
//!   so that all bounds are those of N(0, 1).
//! - z of **a pixel** is *not* normal. With a variance from K renders it follows Student's t with about K − 1 degrees
//!   of freedom (K = 8: 2 % beyond 3, K = 4: 6 %), and path-traced pixels have heavy tails: until a rare bright path
//!   arrives, both mean and variance are too small. Pixels are reported, but not judged. In a block, 64 such variances
//!   are summed: its degrees of freedom are about 64 (K − 1).
//!
//! Differences below [`ROUNDING`] of the mean are f32 arithmetic, not bias. They count as a standard error of that
//! size, which averaging does not reduce.

use std::fmt;

use diptych::image::{Extent, RgbImage};

/// Relative error granted to f32 rendering.
pub const ROUNDING: f64 = 2e-5;
/// Edge of the largest blocks.
const BLOCK: u32 = 8;

/// Running mean and sum of squared deviations (Welford 1962) of an RGB value.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    count: u64,
    mean: [f64; 3],
    squares: [f64; 3],
}

impl Moments {
    fn variance_of_mean(&self) -> [f64; 3] {
        let n = self.count as f64;
        self.squares.map(|s| s / (n - 1.0) / n)
    }

    pub fn add(&mut self, value: [f64; 3]) {
        self.count += 1;
        for (c, x) in value.into_iter().enumerate() {
            let before = x - self.mean[c];
            self.mean[c] += before / self.count as f64;
            self.squares[c] += before * (x - self.mean[c]);
        }
    }
}

/// An image of means, with the variance of each mean; row-major.
#[derive(Clone, Debug)]
pub struct Estimate {
    pub extent: Extent,
    pub mean: Vec<[f64; 3]>,
    pub variance_of_mean: Vec<[f64; 3]>,
    /// Renders from which the mean was computed, if the pixels of a render are dependent.
    renders: Vec<Vec<[f64; 3]>>,
}

impl Estimate {
    /// Estimates from at least two samples per pixel.
    pub fn from_moments(extent: Extent, pixels: &[Moments]) -> Self {
        Self {
            extent,
            mean: pixels.iter().map(|m| m.mean).collect(),
            variance_of_mean: pixels.iter().map(Moments::variance_of_mean).collect(),
            renders: Vec::new(),
        }
    }

    /// Estimates from two or more independent renders. The pixels of a render may be dependent.
    pub fn from_renders(extent: Extent, renders: Vec<Vec<[f64; 3]>>) -> Self {
        assert!(renders.len() >= 2, "a variance needs two renders or more");
        let mut pixels = vec![Moments::default(); extent.area()];
        for render in &renders {
            assert_eq!(render.len(), pixels.len(), "renders differ in size");
            pixels.iter_mut().zip(render).for_each(|(moments, value)| moments.add(*value));
        }
        Self { renders, ..Self::from_moments(extent, &pixels) }
    }

    /// Returns mean and variance of the mean of pixels (by index), taken as one value.
    fn mean_over(&self, pixels: &[usize]) -> [Value; 3] {
        let n = pixels.len() as f64;
        let mean_of = |of: &[[f64; 3]], c: usize| pixels.iter().map(|&i| of[i][c]).sum::<f64>() / n;
        if self.renders.is_empty() {
            return std::array::from_fn(|c| Value {
                mean: mean_of(&self.mean, c),
                variance: mean_of(&self.variance_of_mean, c) / n,
                freedom: f64::INFINITY,
            });
        }
        let mut moments = Moments::default();
        self.renders.iter().for_each(|render| moments.add(std::array::from_fn(|c| mean_of(render, c))));
        let freedom = self.renders.len() as f64 - 1.0;
        let variance = moments.variance_of_mean();
        std::array::from_fn(|c| Value { mean: moments.mean[c], variance: variance[c], freedom })
    }

    /// Returns the largest variance of the image's mean among the channels.
    pub fn variance_of_image(&self) -> f64 {
        let all: Vec<usize> = (0..self.extent.area()).collect();
        max_abs(&self.mean_over(&all).map(|value| value.variance))
    }
}

/// Estimates from K >= 2 renders with independent pixels that differ only in the seed: their mean, and its variance
/// from their spread.
pub fn mean_and_variance(renders: &[RgbImage]) -> Estimate {
    let values = |render: &RgbImage| render.pixels.iter().map(|pixel| pixel.map(f64::from)).collect();
    let estimate = Estimate::from_renders(renders[0].extent, renders.iter().map(values).collect());
    Estimate { renders: Vec::new(), ..estimate }
}

#[derive(Clone, Copy)]
struct Value {
    mean: f64,
    variance: f64,
    /// Degrees of freedom of the variance.
    freedom: f64,
}

/// Returns the degrees of freedom of the sum of these values' variances (Welch 1947).
fn freedom_of_sum(values: [Value; 2]) -> f64 {
    let sum: f64 = values.iter().map(|v| v.variance).sum();
    let spread: f64 = values.iter().map(|v| v.variance * v.variance / v.freedom).sum();
    if spread > 0.0 { sum * sum / spread } else { f64::INFINITY }
}

/// Returns the deviate of N(0, 1) with the same tail probability as `t` of Student's distribution (Wallace 1959).
fn normal_from_student(t: f64, freedom: f64) -> f64 {
    if freedom.is_infinite() {
        return t;
    }
    (freedom * (t * t / freedom).ln_1p()).sqrt().copysign(t) * (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0)
}

/// Inverts [`normal_from_student`].
fn student_from_normal(z: f64, freedom: f64) -> f64 {
    if freedom.is_infinite() {
        return z;
    }
    let scaled = z * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0);
    (freedom * (scaled * scaled / freedom).exp_m1()).sqrt().copysign(z)
}

fn z(a: Value, b: Value) -> f64 {
    let difference = b.mean - a.mean;
    let rounding = ROUNDING * a.mean.abs().max(b.mean.abs());
    let sigma = (a.variance + b.variance + rounding * rounding).sqrt();
    if difference == 0.0 { 0.0 } else { normal_from_student(difference / sigma, freedom_of_sum([a, b])) }
}

/// Result of comparing two estimates. NaN if an image has values that are not finite.
#[derive(Clone, Debug)]
pub struct ZReport {
    /// Pixels of either image with a mean or variance that is not finite.
    pub non_finite: usize,
    /// Fraction of pixel channels with |z| > 3. Under the null 0.0027 at best; see the module.
    pub pixels_beyond_3: f64,
    pub pixel_max: f64,
    /// z of the means of blocks (smaller at right and bottom edges), row-major. N(0, 1) under the null.
    pub block_z: Vec<[f64; 3]>,
    /// z of the mean of the image. N(0, 1) under the null.
    pub image_z: [f64; 3],
    /// Mean of b over mean of a, and its standard error.
    pub mean_ratio: [f64; 3],
    pub mean_ratio_error: [f64; 3],
    /// Relative bias of the image's mean that [`verdict`] detects in nine of ten tries.
    pub surely_found: [f64; 3],
}

impl ZReport {
    /// Returns the mean of the blocks' z² over blocks and channels: 1 under the null, less if some blocks have no
    /// noise.
    pub fn block_mean_square(&self) -> f64 {
        let all = self.block_z.as_flattened();
        all.iter().map(|z| z * z).sum::<f64>() / all.len() as f64
    }

    pub fn block_max(&self) -> f64 {
        max_abs(self.block_z.as_flattened())
    }

    pub fn blocks_beyond_3(&self) -> f64 {
        beyond_3(self.block_z.as_flattened())
    }
}

impl fmt::Display for ZReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "mean ratio   {:.5?} ± {:.5?}", self.mean_ratio, self.mean_ratio_error)?;
        writeln!(f, "image z      {:.2?}, sure to find a bias of {:.5?}", self.image_z, self.surely_found)?;
        writeln!(
            f,
            "blocks       {}: mean z² {:.3}, max |z| {:.2}, {:.2} % beyond 3",
            self.block_z.len(),
            self.block_mean_square(),
            self.block_max(),
            100.0 * self.blocks_beyond_3()
        )?;
        writeln!(
            f,
            "pixels       max |z| {:.2}, {:.2} % beyond 3, {} not finite",
            self.pixel_max,
            100.0 * self.pixels_beyond_3,
            self.non_finite
        )
    }
}

/// Returns the largest magnitude; NaN if any value is NaN.
fn max_abs(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |max, z| if z.abs() <= max { max } else { z.abs() })
}

fn beyond_3(values: &[f64]) -> f64 {
    values.iter().filter(|z| z.abs() > 3.0).count() as f64 / values.len() as f64
}

/// Compares `b` with `a`.
pub fn compare(a: &Estimate, b: &Estimate) -> ZReport {
    assert_eq!(a.extent, b.extent, "images differ in size");
    let extent = a.extent;
    let z_over = |pixels: &[usize]| -> [f64; 3] {
        let (a, b) = (a.mean_over(pixels), b.mean_over(pixels));
        std::array::from_fn(|c| z(a[c], b[c]))
    };
    let all: Vec<usize> = (0..extent.area()).collect();
    let pixel_z: Vec<[f64; 3]> = all.iter().map(|&i| z_over(&[i])).collect();
    let finite = |e: &Estimate, i: usize| e.mean[i].iter().chain(&e.variance_of_mean[i]).all(|x| x.is_finite());
    let (of_a, of_b) = (a.mean_over(&all), b.mean_over(&all));
    // If the means are equal, the ratio is 1, even for black channels.
    let ratio = |c: usize| match (of_a[c].mean, of_b[c].mean) {
        (a, b) if a == b => 1.0,
        (a, b) => b / a,
    };
    let ratio_error = |c: usize| match of_b[c].variance + ratio(c).powi(2) * of_a[c].variance {
        0.0 => 0.0,
        variance => variance.sqrt() / of_a[c].mean,
    };
    // The standard error times z's bound, plus the margin by which z falls short of the bound once in ten times.
    let surely_found =
        |c: usize| ratio_error(c).abs() * (student_from_normal(bound::IMAGE, freedom_of_sum([of_a[c], of_b[c]])) + 1.3);
    ZReport {
        non_finite: all.iter().filter(|&&i| !(finite(a, i) && finite(b, i))).count(),
        pixels_beyond_3: beyond_3(pixel_z.as_flattened()),
        pixel_max: max_abs(pixel_z.as_flattened()),
        block_z: blocks(extent).iter().map(|pixels| z_over(pixels)).collect(),
        image_z: z_over(&all),
        mean_ratio: std::array::from_fn(ratio),
        mean_ratio_error: std::array::from_fn(ratio_error),
        surely_found: std::array::from_fn(surely_found),
    }
}

/// Returns the pixel indices of each block. There are at least four rows of blocks.
fn blocks(extent: Extent) -> Vec<Vec<usize>> {
    let edge = (extent.height / 4).clamp(1, BLOCK);
    let mut blocks = Vec::new();
    for top in (0..extent.height).step_by(edge as usize) {
        for left in (0..extent.width).step_by(edge as usize) {
            let rows = top..(top + edge).min(extent.height);
            let row = |y: u32| {
                let columns = left..(left + edge).min(extent.width);
                columns.map(move |x| y as usize * extent.width as usize + x as usize)
            };
            blocks.push(rows.flat_map(row).collect());
        }
    }
    blocks
}

/// Bounds for [`verdict`]. Each rejects a true null less than once in 10,000 times (the image's mean: 3,000) if the
/// blocks are normal, with a margin for blocks that are not quite.
mod bound {
    /// |z| of the image mean.
    pub const IMAGE: f64 = 3.6;

    /// Returns the bound on |z| of `n` blocks × 3 channels: P(|z| > x) <= exp(−x²/2), divided among all of them, plus
    /// 15 %.
    pub fn block_max(n: usize) -> f64 {
        1.15 * (2.0 * (3.0 * n as f64 * 1e4).ln()).sqrt()
    }

    /// Returns the bound on the mean square over `n` blocks: 1 + 5 standard deviations of χ²/n, plus 0.1.
    pub fn block_mean_square(n: usize) -> f64 {
        1.1 + 5.0 * (2.0 / n as f64).sqrt()
    }

    /// Returns the bound on the fraction of `n` blocks beyond 3. It allows for correlated channels and consists of 1 %
    /// (the normal has 0.27 %), 4 standard deviations of the Poisson count, and 3 blocks, because that count is skewed
    /// if few are expected.
    pub fn blocks_beyond_3(n: usize) -> f64 {
        let expected = 0.01 * n as f64;
        (expected + 4.0 * expected.sqrt() + 3.0) / n as f64
    }
}

/// Returns the evidence against equal means; empty if there is none. A comparison that is too noisy to detect a
/// relative difference of the image mean by `resolution` (e.g. 0.01) fails, too. With well-known variances the standard
/// error must be below 1/4.9 of it, so that such a bias gives |z| = 4.9 ± 1 where 3.6 is allowed.
pub fn verdict(report: &ZReport, resolution: f64) -> Vec<String> {
    let n = report.block_z.len();
    let mut against = Vec::new();
    let mut check = |what: &str, value: f64, limit: f64| {
        // Unlike `value > limit`, this rejects NaN.
        if !matches!(value.partial_cmp(&limit), Some(o) if o.is_le()) {
            against.push(format!("{what}: {value:.4} > {limit:.4}"));
        }
    };
    check("pixels that are not finite", report.non_finite as f64, 0.0);
    check("|z| of the image mean", max_abs(&report.image_z), bound::IMAGE);
    check("max |z| of blocks", report.block_max(), bound::block_max(n));
    check("mean z² of blocks", report.block_mean_square(), bound::block_mean_square(n));
    check("blocks beyond |z| = 3", report.blocks_beyond_3(), bound::blocks_beyond_3(n));
    check("too noisy to tell: bias that is surely found", max_abs(&report.surely_found), resolution);
    against
}

/// Panics, with the report, unless `b` agrees with `a` within noise and that noise is below `resolution`
/// (see [`verdict`]).
pub fn assert_agrees(what: &str, a: &Estimate, b: &Estimate, resolution: f64) -> ZReport {
    let report = compare(a, b);
    let against = verdict(&report, resolution);
    assert!(against.is_empty(), "{what}: the images differ\n{}\n{report}", against.join("\n"));
    report
}
