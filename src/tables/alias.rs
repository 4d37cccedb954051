//! Alias tables, which sample one of n entries in proportion to their weights with one look-up (Walker 1977, built as
//! in Vose 1991).

/// A table entry: index i is kept with probability `keep`, and otherwise replaced by `alias`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    pub keep: f32,
    pub alias: u32,
}

/// Builds the alias table of weights that are not negative and not all zero.
pub fn table(weights: &[f64]) -> Vec<Entry> {
    let n = weights.len();
    let scale = n as f64 / weights.iter().sum::<f64>();
    let mut share: Vec<f64> = weights.iter().map(|w| w * scale).collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| share[i] < 1.0);
    let mut out = vec![Entry { keep: 1.0, alias: 0 }; n];
    while let (Some(s), Some(&l)) = (small.pop(), large.last()) {
        out[s] = Entry { keep: share[s] as f32, alias: l as u32 };
        share[l] -= 1.0 - share[s];
        if share[l] < 1.0 {
            large.pop();
            small.push(l);
        }
    }
    // Leftover entries have probability 1 up to rounding, so they alias to themselves.
    for i in small.into_iter().chain(large).filter(|&i| weights[i] > 0.0) {
        out[i] = Entry { keep: 1.0, alias: i as u32 };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alias_table_samples_in_proportion_to_weights() {
        let weights = [0.5, 0.0, 3.0, 1e-6, 7.0, 2.0];
        let mut got = [0.0; 6];
        let t = table(&weights);
        for (i, e) in t.iter().enumerate() {
            got[i] += f64::from(e.keep) / 6.0;
            got[e.alias as usize] += (1.0 - f64::from(e.keep)) / 6.0;
        }
        let total: f64 = weights.iter().sum();
        for (g, w) in got.iter().zip(weights) {
            assert!((g - w / total).abs() < 1e-7, "{got:?}");
        }
    }
}
