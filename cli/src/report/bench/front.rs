//! Pareto fronts of time and error that the intervals show.

use super::errors::ERROR;
use super::rows::{Measured, SettingRow};
use crate::report::intervals::ratio_interval;
use diptych::control::{MIN_STEP, front};

/// Comparison of two times or errors, by the interval of their ratio.
#[derive(Clone, Copy, Default, PartialEq)]
struct Shown {
    is_less: bool,
    /// True if the first is at most 3 % more, and not shown to be more. Rungs of a ladder differ by as much.
    is_no_more: bool,
}

impl Shown {
    fn new(one: &[f64], other: &[f64]) -> Self {
        let shown =
            |[low, high]: [f64; 2]| Self { is_less: high < 1.0, is_no_more: low <= 1.0 && high <= 1.0 + MIN_STEP };
        ratio_interval(one, other).map(shown).unwrap_or_default()
    }

    fn in_time(one: &Measured, other: &Measured) -> Self {
        Self::new(&one.times_ms(), &other.times_ms())
    }

    fn in_error(one: &Measured, other: &Measured, error: &str) -> Self {
        Self::new(&one.errors_of(error), &other.errors_of(error))
    }
}

/// Returns true if the intervals show that a setting is behind another: slower and not better, or worse and not faster.
fn is_behind(one: &Measured, other: &Measured, error: &str) -> bool {
    let (time, error) = (Shown::in_time(other, one), Shown::in_error(other, one, error));
    time.is_less && error.is_no_more || error.is_less && time.is_no_more || time.is_less && error.is_less
}

/// Returns the indices of the settings on the front of time and `error`, fastest first. The intervals show each to take
/// more time and to have a smaller error than the one before. Where they show the smaller error alone, the better one
/// stays, and otherwise the faster one.
pub(super) fn shown_front(rows: &[&SettingRow], error: &str) -> Vec<usize> {
    let measured = |i: usize| &rows[i].measured;
    let points: Vec<(f64, f64)> = rows.iter().map(|r| (r.measured.time_ms, r.measured.error(error))).collect();
    let mut left = front(&points);
    for i in left.clone() {
        // Of settings that are behind one another, one stays.
        if left.iter().any(|&other| is_behind(measured(i), measured(other), error)) {
            left.retain(|&other| other != i);
        }
    }
    let mut kept: Vec<usize> = Vec::new();
    for i in left {
        let is_slower = |&last: &usize| Shown::in_time(measured(last), measured(i)).is_less;
        let is_better = |&last: &usize| Shown::in_error(measured(i), measured(last), error).is_less;
        while kept.last().is_some_and(|last| !is_slower(last) && is_better(last)) {
            kept.pop();
        }
        if kept.last().is_none_or(|last| is_slower(last) && is_better(last)) {
            kept.push(i);
        }
    }
    kept
}

/// Sets [`SettingRow::on_front`] and [`SettingRow::undecided`] of all rows.
pub fn mark_front(rows: &mut [SettingRow]) {
    let all: Vec<&SettingRow> = rows.iter().collect();
    let on_front = shown_front(&all, ERROR);
    let is_known = |row: &&SettingRow| row.measured.error(ERROR).is_finite();
    let is_behind = |row: &SettingRow| all.iter().any(|other| is_behind(&row.measured, &other.measured, ERROR));
    let undecided: Vec<bool> = all.iter().map(|row| is_known(row) && !is_behind(row)).collect();
    for (i, row) in rows.iter_mut().enumerate() {
        row.on_front = on_front.contains(&i);
        row.undecided = undecided[i] && !row.on_front;
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row_in_turns;
    use super::*;

    /// Times in turns with the scatter of a quiet machine, 1 %, or of a busy one.
    fn in_turns(denoiser: &str, spp: u32, ms: f64, rmse: f64, scatter: f64) -> SettingRow {
        let phase = f64::from(spp) + denoiser.len() as f64;
        let times: Vec<f64> = (0..5).map(|i| ms * (1.0 + scatter * (phase + 2.1 * f64::from(i)).sin())).collect();
        row_in_turns(denoiser, spp, &times, rmse)
    }

    fn marks(mut rows: Vec<SettingRow>) -> Vec<&'static str> {
        mark_front(&mut rows);
        let mark = |r: &SettingRow| match (r.on_front, r.undecided) {
            (true, _) => "front",
            (false, true) => "undecided",
            (false, false) => "",
        };
        rows.iter().map(mark).collect()
    }

    #[test]
    fn front_keeps_only_undominated_rows() {
        let rows = [("none", 1, 1.0, 0.4), ("none", 2, 2.0, 0.3), ("svgf", 1, 1.5, 0.2), ("svgf", 2, 3.0, 0.1)];
        let rows = rows.map(|(denoiser, spp, ms, rmse)| in_turns(denoiser, spp, ms, rmse, 0.01));
        assert_eq!(marks(rows.into()), ["front", "", "front", "front"]);
    }

    #[test]
    fn settings_within_the_scatter_are_not_ranked() {
        let rows = |scatter: f64| vec![in_turns("none", 1, 10.0, 0.4, 0.01), in_turns("none", 2, 10.6, 0.39, scatter)];
        assert_eq!(marks(rows(0.005)), ["front", "front"]);
        // The second has the smaller error, and may be as fast.
        assert_eq!(marks(rows(0.2)), ["undecided", "front"]);
        // Times of a single turn show nothing.
        let once = |denoiser, ms, rmse| row_in_turns(denoiser, 1, &[ms], rmse);
        assert_eq!(marks(vec![once("none", 1.0, 0.4), once("svgf", 9.0, 0.5)]), ["front", "undecided"]);
    }

    #[test]
    fn equal_times_leave_the_better_setting() {
        let rows = vec![in_turns("none", 1, 10.0, 0.4, 0.001), in_turns("svgf", 2, 10.0, 0.1, 0.001)];
        assert_eq!(marks(rows), ["", "front"]);
    }
}
