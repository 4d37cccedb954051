//! Reports times and errors over a grid of settings: rows, CSV, Pareto fronts of time against error, and the quality
//! ladder.

mod errors;
mod front;
mod kinds;
mod rows;
mod tables;
mod charts;
mod ladder;
mod regret;
mod slopes;

pub use charts::{METRICS, svg};
pub use errors::{ERROR, Errors, KindColumns, SeenErrors};
pub use front::mark_front;
pub use kinds::{KIND_NOTE, kind_table};
pub use ladder::{ladder_svg, ladder_table, no_worse, rungs};
pub use regret::{Regret, regret_table, regrets};
pub use rows::{Measured, Repeat, SettingRow, Timed};
pub use slopes::{Slope, slopes};
pub use tables::{ERROR_NOTE, Shared, csv, exposure_note, frames, table, undecided_note};
