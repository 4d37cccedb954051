//! Experiments as data: TOML files that define the arrangements (sets of options) to compare, the columns of results,
//! and published numbers to print beside them.

mod definition;
mod rows;
#[cfg(test)]
mod tests;

pub use definition::{Arrangement, Camera, Experiment, FOVEA, RINGS};
pub use rows::{ExperimentRow, OtherMeasures};
