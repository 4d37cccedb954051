//! Results for people: text tables and SVG charts. Both are strings; where they go is the caller's affair.

pub mod plot;
pub mod run;
pub mod table;
mod ticks;

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
