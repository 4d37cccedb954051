//! Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004, eq. 13): 11x11 Gaussian window of σ 1.5, K1 = 0.01, K2
//! = 0.03, values 0 … 1, population covariance. The mean is over the windows that lie inside the image.

use crate::image::Extent;

/// Radius of the window in pixels, without its centre.
pub const MARGIN: usize = 5;
const TAPS: usize = 2 * MARGIN + 1;
const SIGMA: f64 = 1.5;

/// Returns the mean of [`ssim_map`]; `None` if no window fits.
pub fn ssim(extent: Extent, r: &[[f64; 3]], a: &[[f64; 3]]) -> Option<f64> {
    let map = ssim_map(extent, r, a);
    (!map.is_empty()).then(|| map.iter().sum::<f64>() / map.len() as f64)
}

/// Returns the SSIM, averaged over the three channels, of each pixel whose window lies inside the image, row-major. The
/// map has [`MARGIN`] fewer columns and rows on each side; it is empty if no window fits.
pub fn ssim_map(extent: Extent, r: &[[f64; 3]], a: &[[f64; 3]]) -> Vec<f64> {
    let (width, height) = (extent.width as usize, extent.height as usize);
    if width < TAPS || height < TAPS {
        return Vec::new();
    }
    let [red, green, blue] = [0, 1, 2].map(|c| {
        let [x, y] = [r, a].map(|v| v.iter().map(|p| p[c]).collect::<Vec<f64>>());
        channel_ssim(width, &x, &y)
    });
    red.iter().zip(&green).zip(&blue).map(|((r, g), b)| (r + g + b) / 3.0).collect()
}

fn channel_ssim(width: usize, x: &[f64], y: &[f64]) -> Vec<f64> {
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let products = |u: &[f64], v: &[f64]| u.iter().zip(v).map(|(u, v)| u * v).collect::<Vec<f64>>();
    let mean_x = window_means(width, x);
    let mean_y = window_means(width, y);
    let mean_xx = window_means(width, &products(x, x));
    let mean_yy = window_means(width, &products(y, y));
    let mean_xy = window_means(width, &products(x, y));
    let similarity = |i: usize| {
        let (mx, my) = (mean_x[i], mean_y[i]);
        let variances = mean_xx[i] - mx * mx + mean_yy[i] - my * my;
        let covariance = mean_xy[i] - mx * my;
        (2.0 * mx * my + C1) * (2.0 * covariance + C2) / ((mx * mx + my * my + C1) * (variances + C2))
    };
    (0..mean_x.len()).map(similarity).collect()
}

/// Returns the weighted means of all windows inside the image, row-major: `2 MARGIN` fewer columns and rows than
/// `values`.
fn window_means(width: usize, values: &[f64]) -> Vec<f64> {
    let weights = weights();
    let weigh = |tap: &dyn Fn(usize) -> f64| weights.iter().enumerate().map(|(k, w)| w * tap(k)).sum::<f64>();
    let columns = width - 2 * MARGIN;
    let across: Vec<f64> =
        values.chunks_exact(width).flat_map(|row| row.windows(TAPS).map(|w| weigh(&|k| w[k]))).collect();
    let windows = across.len() - 2 * MARGIN * columns;
    (0..windows).map(|i| weigh(&|k| across[i + k * columns])).collect()
}

fn weights() -> [f64; TAPS] {
    let bell: [f64; TAPS] = std::array::from_fn(|k| {
        let d = k as f64 - MARGIN as f64;
        (-d * d / (2.0 * SIGMA * SIGMA)).exp()
    });
    let sum: f64 = bell.iter().sum();
    bell.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_shift_costs_only_the_luminance_term() {
        let extent = Extent::new(11, 12);
        let (r, a) = (vec![[0.5; 3]; 132], vec![[0.25; 3]; 132]);
        let luminance = (2.0 * 0.125 + 1e-4) / (0.25 + 0.0625 + 1e-4);
        assert!((ssim(extent, &r, &a).unwrap() - luminance).abs() < 1e-9);
    }

    #[test]
    fn ssim_window_sums_to_one_and_is_centred() {
        assert!((weights().iter().sum::<f64>() - 1.0).abs() < 1e-15);
        let (width, height) = (15, 13);
        let ramp: Vec<f64> = (0..width * height).map(|i| (i % width) as f64 + 100.0 * (i / width) as f64).collect();
        let means = window_means(width, &ramp);
        assert_eq!(means.len(), 5 * 3);
        for (i, mean) in means.iter().enumerate() {
            let centre = (i % 5 + MARGIN) as f64 + 100.0 * (i / 5 + MARGIN) as f64;
            assert!((mean - centre).abs() < 1e-9, "{i}");
        }
    }

    #[test]
    fn image_smaller_than_the_window_has_no_ssim() {
        assert_eq!(ssim(Extent::new(10, 11), &[[0.0; 3]; 110], &[[0.0; 3]; 110]), None);
    }
}
