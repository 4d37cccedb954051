//! Pointwise errors: RMSE, relMSE, PSNR, mean ratio and block means. `r` is the reference, `a` the image; both have the
//! same length.

use crate::image::Extent;

pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    sum / count as f64
}

fn pairs<'a>(r: &'a [[f64; 3]], a: &'a [[f64; 3]]) -> impl Iterator<Item = (f64, f64)> {
    r.as_flattened().iter().copied().zip(a.as_flattened().iter().copied())
}

fn mse(r: &[[f64; 3]], a: &[[f64; 3]]) -> f64 {
    mean(pairs(r, a).map(|(r, a)| (a - r).powi(2)))
}

pub fn rmse(r: &[[f64; 3]], a: &[[f64; 3]]) -> f64 {
    mse(r, a).sqrt()
}

/// Relative MSE: mean((a−r)² / (r² + 0.01)).
pub fn relmse(r: &[[f64; 3]], a: &[[f64; 3]]) -> f64 {
    mean(pairs(r, a).map(|(r, a)| (a - r).powi(2) / (r * r + 0.01)))
}

/// Peak signal-to-noise ratio of display values, with peak 1, in dB.
pub fn psnr(r: &[[f64; 3]], a: &[[f64; 3]]) -> f64 {
    -10.0 * mse(r, a).log10()
}

pub fn mean_ratio(r: &[[f64; 3]], a: &[[f64; 3]]) -> Option<f64> {
    let [r, a] = [r, a].map(|v| mean(v.as_flattened().iter().copied()));
    (r != 0.0).then_some(a / r)
}

/// Returns the RMSE of `side` x `side` block means over the mean of the reference. Blocks start at the top left;
/// incomplete blocks at the right and at the bottom are ignored.
pub fn block_error(extent: Extent, side: usize, r: &[[f64; 3]], a: &[[f64; 3]]) -> Option<f64> {
    let [blocks_r, blocks_a] = [r, a].map(|v| block_means(extent, side, v));
    let mean_r = mean(r.as_flattened().iter().copied());
    (!blocks_r.is_empty() && mean_r != 0.0).then(|| rmse(&blocks_r, &blocks_a) / mean_r)
}

fn block_means(extent: Extent, side: usize, values: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let (width, height) = (extent.width as usize, extent.height as usize);
    let columns = width / side;
    let mut means = vec![[0.0; 3]; columns * (height / side)];
    for (y, row) in values.chunks_exact(width).take(height / side * side).enumerate() {
        for (x, value) in row.iter().take(columns * side).enumerate() {
            let block = &mut means[y / side * columns + x / side];
            for (sum, c) in block.iter_mut().zip(value) {
                *sum += c / (side * side) as f64;
            }
        }
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_flat_images_equal_closed_forms() {
        let (r, a) = (vec![[0.5; 3]; 8], vec![[0.6; 3]; 8]);
        assert!((rmse(&r, &a) - 0.1).abs() < 1e-15);
        assert!((relmse(&r, &a) - 0.01 / 0.26).abs() < 1e-15);
        assert!((psnr(&r, &a) - 20.0).abs() < 1e-12);
        assert!((mean_ratio(&r, &a).unwrap() - 1.2).abs() < 1e-15);
    }

    #[test]
    fn blocks_average_noise_out_but_not_a_shift() {
        let extent = Extent::new(5, 4);
        let r = vec![[2.0; 3]; 20];
        let checker: Vec<_> = (0..20).map(|i| [if (i % 5 + i / 5) % 2 == 0 { 1.0 } else { 3.0 }; 3]).collect();
        assert_eq!(block_error(extent, 2, &r, &checker), Some(0.0));
        assert_eq!(block_error(extent, 2, &r, &[[3.0; 3]; 20]), Some(0.5));
        assert_eq!(block_error(extent, 8, &r, &checker), None);
    }

    #[test]
    fn block_error_ignores_incomplete_blocks() {
        let extent = Extent::new(3, 3);
        let r = vec![[1.0; 3]; 9];
        let mut a = r.clone();
        for outside in [2, 5, 6, 7, 8] {
            a[outside] = [100.0; 3];
        }
        assert_eq!(block_error(extent, 2, &r, &a), Some(0.0));
    }
}
