//! Computes quantiles of any number of values in bounded memory.

use std::collections::BTreeMap;

/// Number of values that are kept individually, with exact quantiles.
pub const EXACT: usize = 4096;
/// Ratio of a bin's upper end to its lower end. With more than [`EXACT`] values, only the number of values per bin is
/// kept, and a quantile is the middle of its bin, with a relative error of at most 0.25 %.
const RATIO: f64 = 1.005;

/// Distribution of a stream of values.
#[derive(Clone, Debug)]
pub struct Quantiles {
    values: Values,
    least: f64,
    most: f64,
}

#[derive(Clone, Debug)]
enum Values {
    Exact(Vec<f64>),
    /// Number of values by bin. Floats with logarithms from -745 to 710 fall into at most 292,000 bins; times between a
    /// microsecond and an hour into 4,400.
    Binned {
        bins: BTreeMap<i32, u64>,
        count: u64,
    },
}

impl Default for Quantiles {
    fn default() -> Self {
        Self { values: Values::Exact(Vec::new()), least: f64::INFINITY, most: f64::NEG_INFINITY }
    }
}

impl Quantiles {
    pub fn add(&mut self, value: f64) {
        (self.least, self.most) = (self.least.min(value), self.most.max(value));
        match &mut self.values {
            Values::Exact(values) if values.len() < EXACT => values.push(value),
            Values::Exact(values) => {
                let mut bins = BTreeMap::new();
                let count = values.len() as u64 + 1;
                values.iter().chain([&value]).for_each(|value| *bins.entry(bin(*value)).or_default() += 1);
                self.values = Values::Binned { bins, count };
            }
            Values::Binned { bins, count } => {
                *bins.entry(bin(value)).or_default() += 1;
                *count += 1;
            }
        }
    }

    /// Returns the value below which this fraction of all values lies; `None` without values.
    pub fn quantile(&self, fraction: f64) -> Option<f64> {
        let place = |count: usize| (fraction * count.saturating_sub(1) as f64).round() as usize;
        match &self.values {
            Values::Exact(values) => sorted(values).get(place(values.len())).copied(),
            Values::Binned { bins, count } => {
                let place = place(*count as usize) as u64;
                let sums = bins.iter().scan(0, |below, (bin, count)| {
                    *below += count;
                    Some((*below, *bin))
                });
                let found = sums.into_iter().find(|(below, _)| place < *below);
                found.map(|(_, bin)| middle(bin).min(self.most).max(self.least))
            }
        }
    }

    /// Returns the median; `None` without values. For an even number of exact values, it is the mean of the middle two.
    pub fn median(&self) -> Option<f64> {
        match &self.values {
            Values::Exact(values) => super::median(values.clone()),
            Values::Binned { .. } => self.quantile(0.5),
        }
    }

    /// Returns the largest value; `None` without values.
    pub fn most(&self) -> Option<f64> {
        (self.most >= self.least).then_some(self.most)
    }
}

fn sorted(values: &[f64]) -> Vec<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values
}

/// Returns the bin of a value. Values up to 0 share the lowest bin, and values that are not finite the highest.
fn bin(value: f64) -> i32 {
    match value {
        _ if !value.is_finite() => i32::MAX,
        _ if value <= 0.0 => i32::MIN,
        _ => (value.ln() / RATIO.ln()).round() as i32,
    }
}

fn middle(bin: i32) -> f64 {
    match bin {
        i32::MAX => f64::INFINITY,
        i32::MIN => 0.0,
        _ => (f64::from(bin) * RATIO.ln()).exp(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: impl IntoIterator<Item = f64>) -> Quantiles {
        let mut quantiles = Quantiles::default();
        values.into_iter().for_each(|value| quantiles.add(value));
        quantiles
    }

    #[test]
    fn few_values_have_exact_quantiles() {
        let found = |values: &[f64]| {
            let quantiles = of(values.iter().copied());
            ([0.0, 0.5, 1.0].map(|q| quantiles.quantile(q)), quantiles.median(), quantiles.most())
        };
        assert_eq!(found(&[]), ([None; 3], None, None));
        assert_eq!(found(&[3.0, 1.0, 2.0]), ([1.0, 2.0, 3.0].map(Some), Some(2.0), Some(3.0)));
        assert_eq!(found(&[4.0, 1.0]).1, Some(2.5));
        let most = of((0..EXACT).map(|i| i as f64));
        assert_eq!((most.quantile(0.25), most.quantile(1.0)), (Some(1024.0), Some(4095.0)));
    }

    #[test]
    fn quantiles_of_many_values_are_within_their_bound() {
        // Times range from microseconds to minutes, in shuffled order.
        let values: Vec<f64> = (0..180_000).map(|i| 1e-3 * 1.0001f64.powi(i * 7919 % 180_000)).collect();
        let exact = sorted(&values);
        let quantiles = of(values);
        for fraction in [0.0, 0.001, 0.05, 0.5, 0.95, 0.99, 1.0] {
            let exact = exact[(fraction * (exact.len() - 1) as f64).round() as usize];
            let found = quantiles.quantile(fraction).unwrap();
            assert!((found / exact - 1.0).abs() <= 0.0025, "{fraction}: {found} instead of {exact}");
        }
        assert_eq!(quantiles.most(), exact.last().copied());
    }

    #[test]
    fn quantiles_accept_any_number() {
        let values = [0.0, -1.0, f64::MIN_POSITIVE, 1e308, f64::INFINITY, f64::NAN];
        let quantiles = of(values.into_iter().cycle().take(6000));
        let found = [0.0, 0.1, 0.45, 0.6, 0.9].map(|fraction| quantiles.quantile(fraction).unwrap());
        assert!(found.is_sorted() && found[4] == f64::INFINITY, "{found:?}");
        assert!((found[3] / 1e308 - 1.0).abs() < 0.0026 && found[2] < 1e-307, "{found:?}");
    }
}
