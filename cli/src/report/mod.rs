//! Writes results: text tables, SVG charts and HTML pages for people, CSV and JSON for programs.

pub mod bench;
pub mod comparison;
pub mod csv;
mod frame_row;
pub mod frames;
pub mod headset;
pub mod host;
pub mod html;
pub mod intervals;
pub mod lanes;
pub mod machine;
pub mod peers;
pub mod pictures;
pub mod play;
pub mod plot;
pub mod program;
pub mod quantiles;
pub mod record;
pub mod rectified;
pub mod rings;
pub mod run;
pub mod samples;
pub mod scale;
#[cfg(test)]
mod schema;
pub mod simulation;
pub mod statistics;
pub mod study;
pub mod table;
mod ticks;
pub mod timeline;
pub mod trace;

pub use csv::Csv;
pub use plot::{Chart, Series, line_chart_svg};
pub use table::{Table, text_table};

use diptych::trace::summary::median;

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(
        "the chart '{title}' has nothing to draw: check that a series has finite points, positive ones on a log axis"
    )]
    NothingToDraw { title: String },

    #[error("the chart '{title}' could not be drawn: {reason}")]
    Drawing { title: String, reason: String },

    #[error("the picture '{name}' could not be encoded")]
    Encoding { name: String, source: std::io::Error },

    #[error(transparent)]
    Image(#[from] diptych::image::ImageError),
}

/// Formats a fraction as a percentage.
pub fn percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
}

/// Formats a number; `None` gives the placeholder `-`.
pub fn cell(value: Option<f64>, decimals: usize) -> String {
    value.map_or("-".to_owned(), |v| format!("{v:.decimals$}"))
}

/// Returns the [`median`], or 0 without values.
pub fn median_of(values: Vec<f64>) -> f64 {
    median(values).unwrap_or(0.0)
}

/// Returns each value once, in the order of first occurrence.
pub fn once<T: PartialEq>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut once = Vec::new();
    for value in values {
        if !once.contains(&value) {
            once.push(value);
        }
    }
    once
}

/// Returns the load imbalance: the largest busy time divided by the mean.
fn imbalance(busy_ms: &[f64]) -> f64 {
    busy_ms.iter().copied().fold(0.0, f64::max) * busy_ms.len() as f64 / busy_ms.iter().sum::<f64>().max(1e-9)
}

/// Minimum fraction that [`shares_text`] lists.
const SHARE_MIN: f64 = 0.005;

/// Sums up fractions by name and formats them, largest first, as in `path_trace 61 % atrous 30 %`.
fn shares_text<'a>(shares: impl IntoIterator<Item = (&'a str, f64)>) -> String {
    let mut sums: Vec<(&str, f64)> = Vec::new();
    for (name, share) in shares {
        match sums.iter_mut().find(|(n, _)| *n == name) {
            Some((_, sum)) => *sum += share,
            None => sums.push((name, share)),
        }
    }
    sums.sort_by(|a, b| b.1.total_cmp(&a.1));
    let shown = sums.iter().filter(|(_, share)| *share >= SHARE_MIN);
    shown.map(|(name, share)| format!("{name} {:.0} %", share * 100.0)).collect::<Vec<_>>().join(" ")
}
