//! Pareto fronts of time and error, and a metric to compare them.

/// Returns the indices of the (time, error) pairs on the Pareto front, by rising time and thus falling error. Of equal
/// pairs it takes the first. Pairs that are not finite are ignored.
pub fn front(points: &[(f64, f64)]) -> Vec<usize> {
    let is_finite = |i: &usize| points[*i].0.is_finite() && points[*i].1.is_finite();
    let mut order: Vec<usize> = (0..points.len()).filter(is_finite).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let is_better = points[i].1 < least;
        least = least.min(points[i].1);
        is_better
    });
    order
}

/// Returns the mean error for time limits from `begin` to `end`, weighted evenly over the logarithm of the limit. The
/// error at a limit is the lowest of all (time, error) pairs within it, but at most `worst`, which also applies if no
/// pair is that fast. Lower is better. If the span is empty, returns the error at `end`.
pub fn mean_error(points: &[(f64, f64)], [begin, end]: [f64; 2], worst: f64) -> f64 {
    let (mut sum, mut from, mut error) = (0.0, begin, worst);
    for i in front(points) {
        let (time, next) = points[i];
        if time > end {
            break;
        }
        sum += error * (time.max(from) / from).ln();
        (from, error) = (time.max(from), next.min(worst));
    }
    sum += error * (end / from).ln();
    let span = (end / begin).ln();
    if span > 0.0 { sum / span } else { error }
}

#[cfg(test)]
mod tests {
    use super::{front, mean_error};

    #[test]
    fn mean_error_uses_the_best_setting_in_time() {
        let e = std::f64::consts::E;
        let points = [(e, 0.4), (e * e, 0.2), (e, 0.6)];
        let mean = |begin: f64, end: f64| mean_error(&points, [begin.exp(), end.exp()], 1.0);
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
        near(mean(0.0, 4.0), (1.0 + 0.4 + 0.2 + 0.2) / 4.0);
        near(mean(1.0, 2.0), 0.4);
        near(mean(0.0, 0.5), 1.0);
        near(mean(1.5, 2.5), 0.3);
        near(mean(3.0, 3.0), 0.2);
        near(mean_error(&[], [1.0, 2.0], 0.7), 0.7);
    }

    #[test]
    fn front_keeps_only_undominated_points() {
        let points = [(3.0, 0.1), (1.0, 0.4), (2.0, 0.4), (1.5, 0.2), (1.5, 0.3), (1.5, 0.2), (f64::NAN, 0.0)];
        assert_eq!(front(&points), [1, 3, 0]);
        assert_eq!(front(&[(1.0, f64::NAN)]), [0; 0]);
    }
}
