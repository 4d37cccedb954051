//! Turns in which no other program disturbed the measurement.

use crate::others::NOTICEABLE;
use crate::report::statistics::mean_of_some;

/// Fewest turns that have an interval.
const FEWEST: usize = 6;

/// Which turns count.
pub struct Quiet {
    /// True for each turn that counts.
    counts: Vec<bool>,
    /// Fraction of the cores that other programs took in these turns; `None` if the system does not tell.
    pub others_share: Option<f64>,
    /// Says that other programs were busy.
    pub warning: Option<String>,
}

impl Quiet {
    /// Chooses turns by the fractions of the cores that other programs took. Turns in which they were busy do not count
    /// if enough others are left.
    pub fn of(shares: &[Option<f64>]) -> Self {
        let is_busy = |share: &Option<f64>| share.is_some_and(|share| share >= NOTICEABLE);
        let busy = shares.iter().filter(|share| is_busy(share)).count();
        let leaves_out = busy > 0 && shares.len() - busy >= FEWEST;
        let counts: Vec<bool> = shares.iter().map(|share| !(leaves_out && is_busy(share))).collect();
        let warning =
            mean_of_some(shares.iter().filter(|share| is_busy(share)).filter_map(|share| *share)).map(|share| {
                let effect = match leaves_out {
                    true => "these turns do not count",
                    false => "this run cannot tell speed-ups; measure again when they are done",
                };
                let (percent, all) = (share * 100.0, shares.len());
                format!("other programs took {percent:.0} % of the cores in {busy} of {all} turns: {effect}")
            });
        let others_share =
            mean_of_some(shares.iter().zip(&counts).filter(|(_, counts)| **counts).filter_map(|(s, _)| *s));
        Self { counts, others_share, warning }
    }

    /// Returns the items of the turns that count.
    pub fn of_turns<T: Clone>(&self, of_all: &[T]) -> Vec<T> {
        of_all.iter().zip(&self.counts).filter(|(_, counts)| **counts).map(|(item, _)| item.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the fractions of quiet turns followed by busy ones.
    fn shares(quiet: usize, busy: usize) -> Vec<Option<f64>> {
        [vec![Some(0.01); quiet], vec![Some(0.5); busy]].concat()
    }

    #[test]
    fn busy_turns_count_only_if_too_few_are_left() {
        let numbers: Vec<usize> = (0..12).collect();
        for (quiet, busy, counted, said) in [
            (12, 0, 12, None),
            (6, 6, 6, Some("took 50 % of the cores in 6 of 12 turns: these turns do not count")),
            (5, 7, 12, Some("in 7 of 12 turns: this run cannot tell speed-ups")),
            (0, 12, 12, Some("in 12 of 12 turns: this run cannot tell speed-ups")),
        ] {
            let found = Quiet::of(&shares(quiet, busy));
            assert_eq!(found.of_turns(&numbers).len(), counted, "{quiet} {busy}");
            match (said, &found.warning) {
                (Some(said), Some(warning)) => assert!(warning.contains(said), "{warning}"),
                (said, warning) => assert_eq!((said, warning), (None, &None), "{quiet} {busy}"),
            }
            let share = found.others_share.unwrap();
            assert_eq!(share < NOTICEABLE, said.is_none_or(|said| said.contains("do not count")), "{share}");
        }
        let unknown = Quiet::of(&[None; 3]);
        assert_eq!((unknown.of_turns(&[1, 2, 3]).len(), unknown.others_share, unknown.warning), (3, None, None));
    }
}
