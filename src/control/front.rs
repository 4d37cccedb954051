//! Pareto fronts of time and error.

/// Which of the (time, error) pairs no other one beats in both, by rising time and thus falling error. Of equal pairs the
/// first is taken; what is not finite is on no front.
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

#[cfg(test)]
mod tests {
    use super::front;

    #[test]
    fn a_front_is_what_nothing_beats() {
        let points = [(3.0, 0.1), (1.0, 0.4), (2.0, 0.4), (1.5, 0.2), (1.5, 0.3), (1.5, 0.2), (f64::NAN, 0.0)];
        assert_eq!(front(&points), [1, 3, 0]);
        assert_eq!(front(&[(1.0, f64::NAN)]), [0; 0]);
    }
}
