//! Sets of times, as sorted and disjoint intervals.

/// Begin and end, begin <= end.
pub type Interval = (f64, f64);

/// Returns the union of any intervals, sorted and disjoint.
pub fn union(mut intervals: Vec<Interval>) -> Vec<Interval> {
    intervals.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut merged: Vec<Interval> = Vec::with_capacity(intervals.len());
    for (begin, end) in intervals {
        match merged.last_mut() {
            Some(last) if begin <= last.1 => last.1 = last.1.max(end),
            _ => merged.push((begin, end)),
        }
    }
    merged
}

pub fn length(disjoint: &[Interval]) -> f64 {
    disjoint.iter().map(|(begin, end)| end - begin).sum()
}

/// Returns the length of the intersection of two unions.
pub fn shared_length(a: &[Interval], b: &[Interval]) -> f64 {
    let (mut i, mut j, mut shared) = (0, 0, 0.0);
    while let (Some(&(a0, a1)), Some(&(b0, b1))) = (a.get(i), b.get(j)) {
        shared += (a1.min(b1) - a0.max(b0)).max(0.0);
        if a1 < b1 {
            i += 1;
        } else {
            j += 1;
        }
    }
    shared
}

/// Returns the length of the time that lies in at least two of the unions.
pub fn length_in_two_or_more<'a>(unions: impl IntoIterator<Item = &'a Vec<Interval>>) -> f64 {
    let intervals = unions.into_iter().flatten();
    let mut edges: Vec<(f64, i32)> = intervals.flat_map(|&(begin, end)| [(begin, 1), (end, -1)]).collect();
    edges.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut depth, mut total) = (0, 0.0);
    for pair in edges.windows(2) {
        depth += pair[0].1;
        if depth >= 2 {
            total += pair[1].0 - pair[0].0;
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unions_merge_touching_and_nested_intervals() {
        let merged = union(vec![(5.0, 6.0), (0.0, 2.0), (2.0, 3.0), (0.5, 1.0), (5.5, 8.0)]);
        assert_eq!(merged, [(0.0, 3.0), (5.0, 8.0)]);
        assert_eq!(length(&merged), 6.0);
        assert_eq!(length(&union(vec![])), 0.0);
    }

    #[test]
    fn shares_are_counted_once() {
        let a = [(0.0, 3.0), (5.0, 8.0)];
        assert_eq!(shared_length(&a, &[(2.0, 6.0), (7.0, 9.0)]), 3.0);
        assert_eq!(shared_length(&a, &[]), 0.0);
        assert_eq!(shared_length(&a, &[(3.0, 5.0)]), 0.0);
    }

    #[test]
    fn time_in_two_or_more_is_not_counted_twice() {
        let unions = [vec![(0.0, 4.0)], vec![(1.0, 3.0)], vec![(2.0, 6.0)]];
        assert_eq!(length_in_two_or_more(&unions), 3.0);
        assert_eq!(length_in_two_or_more(&unions[..1]), 0.0);
        assert_eq!(length_in_two_or_more(&[vec![(0.0, 1.0)], vec![(1.0, 2.0)]]), 0.0);
    }
}
