//! Experiments as data: TOML files that name arrangements of options, the columns of the results, and published numbers
//! to print beside them.

mod definition;
mod rows;
#[cfg(test)]
mod tests;

pub use definition::{Arrangement, Camera, Experiment, FOVEA, RINGS};
pub use rows::{ExperimentRow, OtherMeasures};
