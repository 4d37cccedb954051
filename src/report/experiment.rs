//! Experiments as data: TOML files that define the arrangements (sets of options) to compare, the columns of results,
//! and published numbers to print beside them.

mod camera;
mod column;
mod definition;
mod rows;
mod times;
#[cfg(test)]
mod tests;

pub use camera::Camera;
pub use column::{FOVEA, Found, LATENCY, OtherMeasures, RINGS};
pub use definition::{Arrangement, Experiment, Resolution, Shot};
pub use rows::{ExperimentRow, Texts, text_of};
pub use times::FrameTimes;
