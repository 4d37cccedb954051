//! Chooses the range of an axis and its labels.
//!
//! Axis coordinates are the values themselves, or their log10 on a logarithmic axis.

use std::ops::Range;

/// Largest absolute value that an axis can show. Larger values would overflow when the axis is fitted around them.
const LARGEST: f64 = 1e300;

/// Returns the axis coordinate of a value; `None` if the axis cannot show it.
pub(super) fn coordinate(value: f64, log: bool) -> Option<f64> {
    let shown = value.abs() <= LARGEST && (!log || value > 0.0);
    shown.then(|| if log { value.log10() } else { value })
}

/// Range and tick positions of a fitted axis, in axis coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ticks {
    pub log: bool,
    pub range: Range<f64>,
    pub at: Vec<f64>,
}

impl Ticks {
    /// Fits an axis to the coordinates of points; `None` without coordinates.
    pub fn fit(coordinates: impl Iterator<Item = f64>, log: bool) -> Option<Self> {
        let (low, high) = coordinates.map(|c| (c, c)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some(if log { Self::logarithmic(low, high) } else { Self::linear(low, high) })
    }

    /// Moves the ticks of a logarithmic axis to powers of two, if there are at least two on it.
    pub fn with_doubles(self) -> Self {
        let powers = (-64..=64).map(|power| f64::from(power) * 2f64.log10());
        let at: Vec<f64> = powers.filter(|c| self.range.contains(c)).collect();
        if self.log && (2..=20).contains(&at.len()) { Self { at, ..self } } else { self }
    }

    /// Returns the label at an axis coordinate.
    pub fn label(&self, coordinate: f64) -> String {
        number(if self.log { 10f64.powf(coordinate) } else { coordinate })
    }

    /// Chooses ticks at round values, from the one below `low` to the one above `high`. They begin at 0 if `low` is
    /// positive and below half of `high`.
    fn linear(mut low: f64, mut high: f64) -> Self {
        if low == high {
            let around = if low == 0.0 { 1.0 } else { low.abs() / 2.0 };
            (low, high) = (low - around, high + around);
        }
        if low > 0.0 && low < high / 2.0 {
            low = 0.0;
        }
        let at = steps(low, high, f64::floor, f64::ceil);
        Self { log: false, range: at[0]..at[at.len() - 1], at }
    }

    /// Chooses ticks at 1, 2 and 5 times each power of ten, or only at powers of ten if the axis spans many decades. If
    /// fewer than three ticks fit, chooses round values at equal distances.
    fn logarithmic(low: f64, high: f64) -> Self {
        let margin = (0.04 * (high - low)).max(0.02);
        let (low, high) = (low - margin, high + margin);
        let inside = |c: &f64| (low..=high).contains(c);
        let decades = high - low;
        let mantissas: &[f64] = if decades > 3.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let stride = (decades / 8.0).ceil().max(1.0) as usize;
        let powers = (low.floor() as i32..=high.ceil() as i32).step_by(stride);
        let mut at: Vec<f64> =
            powers.flat_map(|p| mantissas.iter().map(move |m| f64::from(p) + m.log10())).filter(inside).collect();
        if at.len() < 3 {
            let values = steps(10f64.powf(low), 10f64.powf(high), f64::ceil, f64::floor);
            at = values.into_iter().map(f64::log10).collect();
        }
        Self { log: true, range: low..high, at }
    }
}

/// Formats a number rounded to ten significant digits, which removes the rounding errors of tick arithmetic.
fn number(value: f64) -> String {
    let exact: f64 = format!("{value:.9e}").parse().unwrap_or(value);
    match exact.abs() {
        0.0 => "0".to_owned(),
        1e-4..1e6 => exact.to_string(),
        _ => format!("{exact:e}"),
    }
}

/// Returns about six ticks at multiples of a step, which is 1, 2 or 5 times a power of ten. `round_low` rounds `low` to
/// the multiple at the first tick, and `round_high` rounds `high` to the multiple at the last tick.
fn steps(low: f64, high: f64, round_low: fn(f64) -> f64, round_high: fn(f64) -> f64) -> Vec<f64> {
    let rough = (high - low) / 6.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= rough * 0.999).unwrap_or(rough);
    // The slack keeps 0.3 / 0.1 from being rounded up to 4 steps.
    let (first, last) = (round_low(low / step + 1e-9), round_high(high / step - 1e-9));
    (0..=(last - first) as usize).map(|i| (first + i as f64) * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64], log: bool) -> Vec<String> {
        let coordinates = values.iter().filter_map(|&v| coordinate(v, log));
        let ticks = Ticks::fit(coordinates, log).unwrap();
        ticks.at.iter().map(|&c| ticks.label(c)).collect()
    }

    #[test]
    fn linear_ticks_are_round_and_enclose_the_data() {
        assert_eq!(labels(&[1.0, 4.0], false), ["0", "1", "2", "3", "4"]);
        assert_eq!(labels(&[0.1, 0.3], false), ["0", "0.05", "0.1", "0.15", "0.2", "0.25", "0.3"]);
        assert_eq!(labels(&[-3.0, 95.0], false), ["-20", "0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(&[100.0, 101.0], false)[..2], ["100", "100.2"]);
    }

    #[test]
    fn log_axes_mark_decades_or_parts_of_them() {
        assert_eq!(labels(&[1.0, 16.0], true), ["1", "2", "5", "10"]);
        assert_eq!(labels(&[1e-5, 1.0], true), ["1e-5", "0.0001", "0.001", "0.01", "0.1", "1"]);
        assert_eq!(labels(&[10.0, 11.0], true), ["10", "10.5", "11", "11.5"]);
    }

    #[test]
    fn doubles_mark_powers_of_two() {
        let labels = |values: [f64; 2]| {
            let ticks = Ticks::fit(values.iter().filter_map(|v| coordinate(*v, true)), true).unwrap().with_doubles();
            ticks.at.iter().map(|c| ticks.label(*c)).collect::<Vec<_>>()
        };
        assert_eq!(labels([1.0, 16.0]), ["1", "2", "4", "8", "16"]);
        // There is only one power of two.
        assert!(labels([0.6, 1.9]).len() > 1);
    }

    #[test]
    fn odd_data_still_gives_an_axis_with_ticks_inside() {
        for values in [[5.0, 5.0], [0.0, 0.0], [-1e300, 1e300], [1e-300, 2e-300], [1e16, 1e16 + 2.0], [1e-200, 1e200]] {
            for log in [false, true] {
                let Some(ticks) = Ticks::fit(values.iter().filter_map(|&v| coordinate(v, log)), log) else {
                    continue;
                };
                assert!(ticks.range.start < ticks.range.end, "{values:?} {log} {ticks:?}");
                assert!((2..=20).contains(&ticks.at.len()), "{values:?} {log} {ticks:?}");
            }
        }
    }

    #[test]
    fn unplottable_values_have_no_coordinate() {
        assert_eq!([f64::NAN, f64::INFINITY].map(|v| coordinate(v, false)), [None; 2]);
        assert_eq!([0.0, -1.0].map(|v| coordinate(v, true)), [None; 2]);
        assert_eq!(Ticks::fit(std::iter::empty(), false), None);
    }
}
