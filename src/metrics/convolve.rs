//! Convolution along rows and columns with a kernel of odd length, which is not flipped. Values outside the image equal
//! the nearest value at the border.

/// Convolves each row of `values`, a row-major image with `width` columns, with `kernel`.
pub fn across(width: usize, values: &[f64], kernel: &[f64]) -> Vec<f64> {
    let radius = kernel.len() / 2;
    let mut sums = vec![0.0; values.len()];
    let mut padded = vec![0.0; width + 2 * radius];
    for (row, out) in values.chunks_exact(width).zip(sums.chunks_exact_mut(width)) {
        padded[..radius].fill(row[0]);
        padded[radius..radius + width].copy_from_slice(row);
        padded[radius + width..].fill(row[width - 1]);
        for (k, &weight) in kernel.iter().enumerate() {
            add_scaled(out, &padded[k..k + width], weight);
        }
    }
    sums
}

/// Convolves each column of `values`, a row-major image with `width` columns, with `kernel`.
pub fn down(width: usize, values: &[f64], kernel: &[f64]) -> Vec<f64> {
    let radius = kernel.len() / 2;
    let last = values.len() / width - 1;
    let mut sums = vec![0.0; values.len()];
    for (y, out) in sums.chunks_exact_mut(width).enumerate() {
        for (k, &weight) in kernel.iter().enumerate() {
            let row = (y + k).saturating_sub(radius).min(last);
            add_scaled(out, &values[row * width..(row + 1) * width], weight);
        }
    }
    sums
}

fn add_scaled(sums: &mut [f64], values: &[f64], weight: f64) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += weight * value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_go_on_and_the_kernel_is_not_turned_around() {
        let (width, kernel) = (3, [1.0, 10.0, 100.0]);
        assert_eq!(across(width, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &kernel), [211.0, 321.0, 332.0, 544.0, 654.0, 665.0]);
        assert_eq!(down(1, &[1.0, 2.0, 3.0], &kernel), [211.0, 321.0, 332.0]);
        assert_eq!(down(2, &[1.0, 2.0], &kernel), [111.0, 222.0]);
    }

    #[test]
    fn kernels_can_be_longer_than_the_image() {
        assert_eq!(across(1, &[2.0], &[1.0; 21]), [42.0]);
        assert_eq!(down(1, &[2.0], &[1.0; 21]), [42.0]);
    }
}
