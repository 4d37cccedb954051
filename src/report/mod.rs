//! Results for people: text tables and SVG charts. Both are strings; where they go is the caller's affair.

pub mod bench;
pub mod plot;
pub mod run;
pub mod table;
mod ticks;
pub mod trace;

pub use plot::{Axis, Chart, Series, line_chart_svg};
pub use table::text_table;

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(
        "the chart '{title}' has nothing to draw: check that a series has finite points, positive ones on a log axis"
    )]
    NothingToDraw { title: String },

    #[error("the chart '{title}' could not be drawn: {reason}")]
    Drawing { title: String, reason: String },
}

/// The middle value, of an even number the upper one; 0 of none.
pub fn median_of(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
