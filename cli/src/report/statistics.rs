//! Statistics of a few values.

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the mean of some values; `None` without any.
pub fn mean_of_some(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Returns the sample standard deviation (with divisor n − 1).
pub fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}

/// Returns lower quartile, median and upper quartile, interpolated linearly between ranks; 0 without values.
pub fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|share| {
        let at = share * values.len().saturating_sub(1) as f64;
        let value = |i: f64| values.get(i as usize).copied().unwrap_or(0.0);
        value(at.floor()) + (value(at.ceil()) - value(at.floor())) * at.fract()
    })
}

/// Returns the interquartile range, interpolated linearly (type 7 of Hyndman & Fan, "Sample Quantiles", 1996).
pub fn interquartile_range(values: Vec<f64>) -> f64 {
    let [lower, _, upper] = quartiles(values);
    upper - lower
}

/// Returns the ends of the 95 % interval of the median, which are order statistics and hold for any distribution;
/// `None` for fewer than six values, which have no such interval.
pub fn interval_of_median(values: &[f64]) -> Option<[f64; 2]> {
    let (count, mut below, mut term) = (values.len(), 0.0, 0.5f64.powi(values.len() as i32));
    // The number of values below the median is binomial.
    let mut rank = 0;
    while rank < count && below + term <= 0.025 {
        below += term;
        term *= (count - rank) as f64 / (rank + 1) as f64;
        rank += 1;
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    (rank > 0).then(|| [sorted[rank - 1], sorted[count - rank]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_ranks() {
        assert_eq!(quartiles(vec![4.0, 1.0, 3.0, 2.0, 5.0]), [2.0, 3.0, 4.0]);
        assert_eq!(quartiles(vec![1.0, 2.0]), [1.25, 1.5, 1.75]);
        assert_eq!(quartiles(vec![7.0]), [7.0; 3]);
        assert_eq!(quartiles(Vec::new()), [0.0; 3]);
        assert_eq!(interquartile_range(vec![5.0, 1.0, 2.0, 4.0, 3.0]), 2.0);
    }

    #[test]
    fn interval_of_median_equals_the_sign_test() {
        let values = |count: u32| (1..=count).rev().map(f64::from).collect::<Vec<_>>();
        assert_eq!(interval_of_median(&values(5)), None);
        // Conover 1999, table A3: the ranks for 95 % are 1 of 6, 2 of 10, 6 of 20 and 40 of 100.
        for (count, [low, high]) in [(6, [1.0, 6.0]), (10, [2.0, 9.0]), (20, [6.0, 15.0]), (100, [40.0, 61.0])] {
            assert_eq!(interval_of_median(&values(count)), Some([low, high]), "{count}");
        }
    }
}
