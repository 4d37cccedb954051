//! Random numbers of a run.

use serde::{Deserialize, Serialize};

/// Source of random numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampler {
    /// Owen-scrambled Sobol'.
    #[default]
    Sobol,
    /// Independent random numbers (PCG)
    Pcg,
}
